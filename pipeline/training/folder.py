"""The folder of a training. It holds checkpoint.safetensors, log.jsonl (schemas.training), curve.png and, at the end,
weights.safetensors. The same command resumes from the checkpoint. Training steps are in stages.flow.training.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from pipeline.store.files import write_atomically
from pipeline.training.batches import batches
from schemas.config import TrainFlowConfig
from schemas.errors import InputError
from schemas.training import Measurement, Step
from stages.flow.network.weights import DIGEST, read_safetensors, safetensors_bytes, weights_file
from stages.flow.training.curve import curve_png
from stages.flow.training.learning import Batch
from stages.flow.training.loop import Learner, learn
from stages.flow.training.source import PairSource, check_robots, validation_pairs

CHECKPOINT, LOG, CURVE, WEIGHTS = "checkpoint.safetensors", "log.jsonl", "curve.png", "weights.safetensors"
CHECKPOINT_FORMAT = "rearticulate flow training 2"

_log = logging.getLogger("rearticulate.training")

Line = Annotated[Step | Measurement, Field(discriminator="kind")]
LINES: TypeAdapter[Line] = TypeAdapter(Line)


def train(
    config: TrainFlowConfig, folder: Path, assets: Path | None, report: Callable[[Line], Any] = lambda line: None
) -> Path:
    """Start or resume training in `folder`, and return the path of the weights. `report` gets each line of the log.

    The same configuration and robots give the same batches, but floating-point sums may differ between machines.

    Raises InputError for robots that it cannot train or measure on, for a checkpoint that is damaged or of another
    configuration, and for a learning rate at which training diverges. Raises MakerDied if the process that makes pairs
    ends too early.
    """
    check_robots(config)
    learner, log = resume(config, folder)
    validation = [Batch.of([pair]) for pair in validation_pairs(config, assets)]
    before, start = log[-1].seconds if log else 0.0, time.perf_counter()

    def clock() -> float:
        return before + time.perf_counter() - start

    for line in learn(learner, batches(PairSource(config, assets), config, learner.step), validation, clock):
        log.append(line)
        report(line)
        if isinstance(line, Measurement):
            save(learner, log, folder)
    notes = {"config": config.model_dump_json(), "steps": str(learner.step)}
    write_atomically(folder / WEIGHTS, weights_file(learner.network, notes))
    return folder / WEIGHTS


def resume(config: TrainFlowConfig, folder: Path) -> tuple[Learner, list[Line]]:
    """Restore the learner from a folder's checkpoint, or start a new one, and read the log up to that step.

    Raises InputError for a checkpoint that is damaged or of another configuration.
    """
    learner, path = Learner.start(config), folder / CHECKPOINT
    if not os.path.lexists(path):
        return learner, []
    with _advising(path):
        tensors, notes = read_safetensors(path, CHECKPOINT_FORMAT)
        if DIGEST not in notes or not {"config", "step"} <= notes.keys():
            raise InputError(f"{path}: found no {DIGEST}, config or step, expected those of a checkpoint")
    if notes["config"] != config.model_dump_json():
        raise InputError(
            f"{path}: found a training with other settings, expected these; "
            "go on with the settings that it was begun with, or give another folder"
        )
    with _advising(path):
        learner.restore(tensors, notes["step"], str(path))
    return learner, [line for line in _read_log(folder / LOG) if line.step <= learner.step]


def save(learner: Learner, log: Sequence[Line], folder: Path) -> None:
    """Write log, checkpoint and curve. The log comes first, since resuming drops its lines beyond the checkpoint."""
    write_atomically(folder / LOG, "".join(f"{line.model_dump_json()}\n" for line in log).encode())
    notes = {"format": CHECKPOINT_FORMAT, "step": str(learner.step), "config": learner.config.model_dump_json()}
    write_atomically(folder / CHECKPOINT, safetensors_bytes(learner.state(), notes))
    steps = [line for line in log if isinstance(line, Step)]
    measurements = [line for line in log if isinstance(line, Measurement)]
    write_atomically(folder / CURVE, curve_png(steps, measurements))


def _read_log(path: Path) -> Iterator[Line]:
    """The readable lines of an earlier log. A damaged log does not stop training."""
    lines = path.read_bytes().splitlines() if path.is_file() else []
    for number, line in enumerate(lines, start=1):
        try:
            yield LINES.validate_json(line)
        except ValidationError:
            _log.warning("%s: line %d cannot be read; it is left out", path, number)


@contextmanager
def _advising(path: Path) -> Iterator[None]:
    """Add advice to errors about a checkpoint."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{error}; remove {path} to begin anew, or give another folder") from error
