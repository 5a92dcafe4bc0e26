"""The batches of a training, made by a process of its own while the network learns.

They come through a pipe: a queue between processes that do not fork needs named semaphores, which are left behind where
all processes are killed at once.
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
    """The process that makes pairs ended before its work was done; the message says how."""


def batches(source: PairSource, config: TrainFlowConfig, first: int) -> Iterator[Batch]:
    """The batches from step `first` on, each in time for the one before to be learned from.

    Raises InputError as the source does, and MakerDied where the other process is killed or fails.
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
    """Send the pairs of each step, or the message of what cannot be used."""
    die_with_forking_parent()
    import torch

    torch.set_num_threads(1)  # the other processor is learning
    try:
        for step in steps:
            sender.send([source[index] for index in range(step * size, (step + 1) * size)])
    except InputError as error:
        sender.send(str(error))
    except (BrokenPipeError, KeyboardInterrupt):
        pass  # nobody listens any more
    except Exception:
        traceback.print_exc()
        raise SystemExit(1) from None
