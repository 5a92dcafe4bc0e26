"""Training of the flow network: the loop over steps, with checkpoints, a log and a curve (A.1).

A run's folder holds checkpoint.safetensors, from which the same command goes on, log.jsonl (schemas.training),
curve.png, and at the end weights.safetensors. What a step does is in stages.training.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import torch
from pydantic import Field, TypeAdapter
from safetensors.torch import save
from torch.utils.data import DataLoader

from pipeline.files import write_atomically
from schemas.config import TrainFlowConfig
from schemas.errors import InputError
from schemas.training import Measurement, Step
from stages.flow.network.model import FeatureNetwork
from stages.flow.network.weights import read_safetensors, weights_file
from stages.training.curve import draw_curve
from stages.training.learning import Batch, matching_loss, score, turned
from stages.training.source import PairSource, check_robots, validation_pairs

CHECKPOINT, LOG, CURVE, WEIGHTS = "checkpoint.safetensors", "log.jsonl", "curve.png", "weights.safetensors"
CHECKPOINT_FORMAT = "rearticulate flow training 1"
WARM_UP = 0.04  # share of the steps in which the rate rises
GREATEST_GRADIENT = 5.0
TURNS = 2  # stream of random numbers, beside those of stages.training.source
PREFETCHED = 4  # batches that wait, made by a process of its own

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
        """Where a folder's checkpoint left off. Raises InputError for one of another configuration."""
        training = cls.start(config)
        if not (folder / CHECKPOINT).exists():
            return training
        tensors, notes = read_safetensors(folder / CHECKPOINT, CHECKPOINT_FORMAT)
        if notes["config"] != config.model_dump_json():
            raise InputError(
                f"{folder / CHECKPOINT}: found a training with other settings, expected these; "
                "go on with the settings that it was begun with, or give another folder"
            )
        training.network.load_state_dict(_under("network", tensors))
        state = training.optimizer.state_dict()
        for name, value in _under("optimizer", tensors).items():
            parameter, _, entry = name.partition(".")
            state["state"].setdefault(int(parameter), {})[entry] = value
        training.optimizer.load_state_dict(state)
        training.step = int(notes["step"])
        lines = map(LINES.validate_json, (folder / LOG).read_text().splitlines())
        training.log = [line for line in lines if line.step <= training.step]
        return training

    def save(self, folder: Path) -> None:
        """Write checkpoint, log and curve. The log is written first: lines beyond a checkpoint are dropped."""
        write_atomically(folder / LOG, "".join(f"{line.model_dump_json()}\n" for line in self.log).encode())
        tensors = {f"network.{name}": value for name, value in self.network.state_dict().items()}
        for parameter, entries in self.optimizer.state_dict()["state"].items():
            tensors |= {f"optimizer.{parameter}.{name}": value for name, value in entries.items()}
        notes = {"format": CHECKPOINT_FORMAT, "step": str(self.step), "config": self.config.model_dump_json()}
        write_atomically(folder / CHECKPOINT, save(tensors, notes))
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
    to another. Raises InputError for robots that it cannot train or measure on, and for a folder with a checkpoint of
    another configuration.
    """
    check_robots(config)
    training = Training.resume(config, folder)
    validation = [Batch.of([pair]) for pair in validation_pairs(config, assets)]
    before = training.log[-1].seconds if training.log else 0.0
    clock = time.perf_counter()

    def note(line: Line) -> None:
        training.log.append(line)
        report(line)

    for batch in _batches(config, assets, training.step):
        loss = _learn(training, batch)
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


def _batches(config: TrainFlowConfig, assets: Path | None, first: int) -> Iterable[Batch]:
    """The batches from step `first` on, made by another process while this one learns."""
    size = config.batch
    return DataLoader(
        PairSource(config, assets),
        batch_sampler=[list(range(k * size, (k + 1) * size)) for k in range(first, config.steps)],
        collate_fn=Batch.of,
        num_workers=1,
        prefetch_factor=PREFETCHED,
        multiprocessing_context="spawn",
    )


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
