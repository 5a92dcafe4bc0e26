"""The training loop (A.1): one gradient step for each batch, with a measurement at regular intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Self

import numpy as np
import torch
from torch import Tensor

from schemas.config import TrainFlowConfig
from schemas.errors import InputError
from schemas.training import Measurement, Step
from stages.flow.network.model import FeatureNetwork
from stages.flow.network.weights import check_state
from stages.flow.training.learning import Batch, matching_loss, score, turned

WARM_UP = 0.04  # share of the steps in which the learning rate rises
GREATEST_GRADIENT = 5.0
TURNS = 2  # stream of random numbers, besides those of stages.flow.training.source


@dataclass
class Learner:
    """A network in training, with the optimiser's state and the number of steps taken."""

    config: TrainFlowConfig
    network: FeatureNetwork
    optimizer: torch.optim.Optimizer
    step: int = 0

    @classmethod
    def start(cls, config: TrainFlowConfig) -> Self:
        """Start with random weights, from the configuration's seed."""
        torch.manual_seed(config.seed)
        network = FeatureNetwork()
        optimizer = torch.optim.AdamW(network.parameters(), config.learning_rate, weight_decay=config.weight_decay)
        return cls(config, network, optimizer)

    def state(self) -> dict[str, Tensor]:
        """The weights as `network.<name>` and the momenta as `optimizer.<parameter>.<name>`."""
        tensors = {f"network.{name}": value for name, value in self.network.state_dict().items()}
        for parameter, entries in self.optimizer.state_dict()["state"].items():
            tensors |= {f"optimizer.{parameter}.{name}": value for name, value in entries.items()}
        return tensors

    def restore(self, tensors: dict[str, Tensor], step: str, origin: str) -> None:
        """Resume from a `state` after the given step.

        Raises InputError, which starts with `origin`, if the state does not fit the network.
        """
        weights = _under("network", tensors)
        check_state(origin, weights, self.network.state_dict())
        if not step.isdecimal() or not 0 < int(step) <= self.config.steps:
            raise InputError(f"{origin}: found step {step!r}, expected one of 1..{self.config.steps}")
        momenta = self._momenta(_under("optimizer", tensors), origin)
        self.network.load_state_dict(weights)
        self.optimizer.load_state_dict({**self.optimizer.state_dict(), "state": momenta})
        self.step = int(step)

    def _momenta(self, tensors: dict[str, Tensor], origin: str) -> dict[int, dict[str, Tensor]]:
        """The optimiser's entries by parameter. Raises InputError if some are missing, unknown or not finite."""
        entries: dict[int, dict[str, Tensor]] = {}
        parameters = list(self.network.parameters())
        for name, value in tensors.items():
            parameter, _, entry = name.partition(".")
            known = parameter.isdecimal() and int(parameter) < len(parameters)
            if not known or value.shape not in (parameters[int(parameter)].shape, ()) or not value.isfinite().all():
                raise InputError(
                    f"{origin}: optimizer.{name}: found what no parameter has, or NaN, expected its momenta"
                )
            entries.setdefault(int(parameter), {})[entry] = value
        if any(set(entries.get(k, ())) != {"step", "exp_avg", "exp_avg_sq"} for k in range(len(parameters))):
            raise InputError(f"{origin}: found no momenta of some parameters, expected those of all")
        return entries


def learn(
    learner: Learner, batches: Iterable[Batch], validation: Sequence[Batch], clock: Callable[[], float]
) -> Iterator[Step | Measurement]:
    """Take one step for each batch and yield it. Also yield a measurement every `validate_every` steps and at the end.

    `clock` returns the seconds since training began. Raises InputError for a learning rate at which training diverges.
    """
    config = learner.config
    for batch in batches:
        loss = descend(learner, batch)
        if not math.isfinite(loss) or not _finite(learner.network):
            raise InputError(
                f"step {learner.step + 1}: found a loss of {loss}, or weights that are not finite, expected numbers; "
                f"lower learning_rate and begin anew in another folder"
            )
        learner.step += 1
        rate = learner.optimizer.param_groups[0]["lr"]
        yield Step(step=learner.step, loss=loss, learning_rate=rate, seconds=clock())
        if learner.step % config.validate_every == 0 or learner.step == config.steps:
            yield Measurement(step=learner.step, seconds=clock(), **asdict(score(learner.network, validation)))


def descend(learner: Learner, batch: Batch) -> float:
    """Take one gradient step, in half precision if the processor supports it. Return the loss before it."""
    config = learner.config
    batch = turned(batch, config.turn_degrees, np.random.default_rng((config.seed, TURNS, learner.step)))
    for group in learner.optimizer.param_groups:
        group["lr"] = config.learning_rate * _share_of_rate(learner.step, config.steps)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        loss = matching_loss(learner.network, batch)
    learner.optimizer.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(learner.network.parameters(), GREATEST_GRADIENT)
    learner.optimizer.step()
    return loss.item()


def _finite(network: FeatureNetwork) -> bool:
    return all(bool(parameter.isfinite().all()) for parameter in network.parameters())


def _share_of_rate(step: int, steps: int) -> float:
    """The factor of the learning rate. It rises linearly, then falls as a cosine."""
    warm = max(1.0, WARM_UP * steps)
    if step < warm:
        return (step + 1) / (warm + 1)
    return 0.5 * (1 + math.cos(math.pi * (step - warm) / (steps - warm)))


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """The tensors below a prefix, by their names without `prefix.`."""
    return {name.removeprefix(f"{prefix}."): value for name, value in tensors.items() if name.startswith(f"{prefix}.")}
