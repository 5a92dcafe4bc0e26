"""Training of the flow network: the loop over steps, with checkpoints, a log and a curve (A.1).

A run's folder holds checkpoint.safetensors, from which the same command goes on, log.jsonl (schemas.training),
curve.png, and at the end weights.safetensors. What a step does is in stages.flow.training.
"""

from __future__ import annotations

import logging
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import torch
from pydantic import Field, TypeAdapter, ValidationError

from pipeline.store.files import write_atomically
from pipeline.training_batches import batches
from schemas.config import TrainFlowConfig
from schemas.errors import InputError
from schemas.training import Measurement, Step
from stages.flow.network.model import FeatureNetwork
from stages.flow.network.weights import DIGEST, check_state, read_safetensors, safetensors_bytes, weights_file
from stages.flow.training.curve import draw_curve
from stages.flow.training.learning import Batch, matching_loss, score, turned
from stages.flow.training.source import PairSource, check_robots, validation_pairs

CHECKPOINT, LOG, CURVE, WEIGHTS = "checkpoint.safetensors", "log.jsonl", "curve.png", "weights.safetensors"
CHECKPOINT_FORMAT = "rearticulate flow training 2"
WARM_UP = 0.04  # share of the steps in which the rate rises
GREATEST_GRADIENT = 5.0
TURNS = 2  # stream of random numbers, beside those of stages.flow.training.source

_log = logging.getLogger("rearticulate.training")

Line = Annotated[Step | Measurement, Field(discriminator="kind")]
LINES: TypeAdapter[Line] = TypeAdapter(Line)


@dataclass
class Training:
    """A network on its way: what a checkpoint holds, and the log so far."""

    config: TrainFlowConfig
    network: FeatureNetwork
    optimizer: torch.optim.Optimizer
    step: int = 0
    log: list[Line] = field(default_factory=list)

    @classmethod
    def start(cls, config: TrainFlowConfig) -> Self:
        torch.manual_seed(config.seed)
        network = FeatureNetwork()
        optimizer = torch.optim.AdamW(network.parameters(), config.learning_rate, weight_decay=config.weight_decay)
        return cls(config, network, optimizer)

    @classmethod
    def resume(cls, config: TrainFlowConfig, folder: Path) -> Self:
        """Where a folder's checkpoint left off.

        Raises InputError for one of another configuration, and for one that is damaged.
        """
        training, path = cls.start(config), folder / CHECKPOINT
        if not os.path.lexists(path):
            return training
        with _told_what_to_do(path):
            tensors, notes = read_safetensors(path, CHECKPOINT_FORMAT)
            if DIGEST not in notes or not {"config", "step"} <= notes.keys():
                raise InputError(f"{path}: found no {DIGEST}, config or step, expected those of a checkpoint")
        if notes["config"] != config.model_dump_json():
            raise InputError(
                f"{path}: found a training with other settings, expected these; "
                "go on with the settings that it was begun with, or give another folder"
            )
        with _told_what_to_do(path):
            training._take(tensors, notes["step"], path)
        training.log = [line for line in _read_log(folder / LOG) if line.step <= training.step]
        return training

    def _take(self, tensors: dict[str, torch.Tensor], step: str, path: Path) -> None:
        """Go on from what a checkpoint holds. Raises InputError where that does not fit the network."""
        weights = _under("network", tensors)
        check_state(path, weights, self.network.state_dict())
        if not step.isdecimal() or not 0 < int(step) <= self.config.steps:
            raise InputError(f"{path}: found step {step!r}, expected one of 1..{self.config.steps}")
        state = self.optimizer.state_dict()
        entries: dict[int, dict[str, torch.Tensor]] = {}
        parameters = list(self.network.parameters())
        for name, value in _under("optimizer", tensors).items():
            parameter, _, entry = name.partition(".")
            known = parameter.isdecimal() and int(parameter) < len(parameters)
            if not known or value.shape not in (parameters[int(parameter)].shape, ()) or not value.isfinite().all():
                raise InputError(f"{path}: optimizer.{name}: found what no parameter has, or NaN, expected its momenta")
            entries.setdefault(int(parameter), {})[entry] = value
        if any(set(entries.get(k, ())) != {"step", "exp_avg", "exp_avg_sq"} for k in range(len(parameters))):
            raise InputError(f"{path}: found no momenta of some parameters, expected those of all")
        self.network.load_state_dict(weights)
        self.optimizer.load_state_dict({**state, "state": entries})
        self.step = int(step)

    def save(self, folder: Path) -> None:
        """Write checkpoint, log and curve. The log is written first: lines beyond a checkpoint are dropped."""
        write_atomically(folder / LOG, "".join(f"{line.model_dump_json()}\n" for line in self.log).encode())
        tensors = {f"network.{name}": value for name, value in self.network.state_dict().items()}
        for parameter, entries in self.optimizer.state_dict()["state"].items():
            tensors |= {f"optimizer.{parameter}.{name}": value for name, value in entries.items()}
        notes = {"format": CHECKPOINT_FORMAT, "step": str(self.step), "config": self.config.model_dump_json()}
        write_atomically(folder / CHECKPOINT, safetensors_bytes(tensors, notes))
        draw_curve(self.steps(), self.measurements(), folder / CURVE)

    def steps(self) -> list[Step]:
        return [line for line in self.log if isinstance(line, Step)]

    def measurements(self) -> list[Measurement]:
        return [line for line in self.log if isinstance(line, Measurement)]


def train(
    config: TrainFlowConfig, folder: Path, assets: Path | None, report: Callable[[Line], Any] = lambda line: None
) -> Path:
    """Train, or go on training, in `folder`; the path of the weights. `report` is called with each line of the log.

    The same configuration and robots give the same batches; sums of floating-point numbers may differ from one machine
    to another. Raises InputError for robots that it cannot train or measure on, for a folder with a checkpoint that is
    damaged or of another configuration, and for a rate at which the network gets lost; MakerDied where the process that
    makes pairs does.
    """
    check_robots(config)
    training = Training.resume(config, folder)
    validation = [Batch.of([pair]) for pair in validation_pairs(config, assets)]
    before = training.log[-1].seconds if training.log else 0.0
    clock = time.perf_counter()

    def note(line: Line) -> None:
        training.log.append(line)
        report(line)

    for batch in batches(PairSource(config, assets), config, training.step):
        loss = _learn(training, batch)
        if not math.isfinite(loss) or not _finite(training.network):
            raise InputError(
                f"step {training.step + 1}: found a loss of {loss}, or weights that are not finite, expected numbers; "
                f"lower learning_rate and begin anew in another folder"
            )
        training.step += 1
        seconds = before + time.perf_counter() - clock
        rate = training.optimizer.param_groups[0]["lr"]
        note(Step(step=training.step, loss=loss, learning_rate=rate, seconds=seconds))
        if training.step % config.validate_every == 0 or training.step == config.steps:
            seconds = before + time.perf_counter() - clock
            note(Measurement(step=training.step, seconds=seconds, **asdict(score(training.network, validation))))
            training.save(folder)
    notes = {"config": config.model_dump_json(), "steps": str(training.step)}
    write_atomically(folder / WEIGHTS, weights_file(training.network, notes))
    return folder / WEIGHTS


def _read_log(path: Path) -> Iterator[Line]:
    """The lines of an earlier log that can be read: no training is lost for its log."""
    lines = path.read_bytes().splitlines() if path.is_file() else []
    for number, line in enumerate(lines, start=1):
        try:
            yield LINES.validate_json(line)
        except ValidationError:
            _log.warning("%s: line %d cannot be read; it is left out", path, number)


@contextmanager
def _told_what_to_do(path: Path) -> Iterator[None]:
    """What is said of a checkpoint ends with the way out."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{error}; remove {path} to begin anew, or give another folder") from error


def _finite(network: FeatureNetwork) -> bool:
    return all(bool(parameter.isfinite().all()) for parameter in network.parameters())


def _learn(training: Training, batch: Batch) -> float:
    """One step down the loss, in half precision where the processor has it; the loss."""
    config = training.config
    batch = turned(batch, config.turn_degrees, np.random.default_rng((config.seed, TURNS, training.step)))
    for group in training.optimizer.param_groups:
        group["lr"] = config.learning_rate * _share_of_rate(training.step, config.steps)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        loss = matching_loss(training.network, batch)
    training.optimizer.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(training.network.parameters(), GREATEST_GRADIENT)
    training.optimizer.step()
    return loss.item()


def _share_of_rate(step: int, steps: int) -> float:
    """Rises in a line, then falls as a cosine."""
    warm = max(1.0, WARM_UP * steps)
    if step < warm:
        return (step + 1) / (warm + 1)
    return 0.5 * (1 + math.cos(math.pi * (step - warm) / (steps - warm)))


def _under(prefix: str, tensors: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """The tensors whose names begin with the prefix and a dot, without it."""
    return {name.removeprefix(f"{prefix}."): value for name, value in tensors.items() if name.startswith(f"{prefix}.")}
