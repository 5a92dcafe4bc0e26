"""Training batches, which a separate process makes while the network learns.

They come through a pipe. A queue between processes that do not fork would need named semaphores, which remain if all
processes are killed at once.
"""

from __future__ import annotations

import multiprocessing
import traceback
from collections.abc import Iterator
from multiprocessing.connection import Connection

from pipeline.run.processes import die_with_forking_parent, how_it_ended
from schemas.config import TrainFlowConfig
from schemas.errors import InputError
from stages.flow.training.learning import Batch
from stages.flow.training.source import PairSource


class MakerDied(Exception):
    """The process that makes pairs ended too early. The message says how."""


def batches(source: PairSource, config: TrainFlowConfig, first: int) -> Iterator[Batch]:
    """Yield the batches from step `first` on. Each is made while the network learns from the one before.

    Raises InputError as the source does, and MakerDied if the other process is killed or fails.
    """
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    maker = context.Process(target=_make, args=(source, range(first, config.steps), config.batch, sender), daemon=True)
    maker.start()
    sender.close()
    try:
        for _ in range(first, config.steps):
            try:
                made = receiver.recv()
            except (EOFError, OSError) as error:
                maker.join()
                raise MakerDied(how_it_ended(maker.exitcode or 0)) from error
            if isinstance(made, str):
                raise InputError(made)
            yield Batch.of(made)
    finally:
        receiver.close()
        maker.kill()
        maker.join()


def _make(source: PairSource, steps: range, size: int, sender: Connection) -> None:
    """Send the pairs of each step, or the message of an InputError."""
    die_with_forking_parent()
    import torch

    torch.set_num_threads(1)  # leave the other processor to the learning
    try:
        for step in steps:
            sender.send([source[index] for index in range(step * size, (step + 1) * size)])
    except InputError as error:
        sender.send(str(error))
    except (BrokenPipeError, KeyboardInterrupt):
        pass  # the reader is gone
    except Exception:
        traceback.print_exc()
        raise SystemExit(1) from None
