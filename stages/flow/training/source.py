"""The source of training pairs: available robots, and random shapes."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from schemas.config import TrainFlowConfig
from schemas.errors import InputError, UnavailableError
from stages.flow.training.pairs import Pair, make_pair
from stages.flow.training.robots import robot_shape
from stages.flow.training.shapes import PosableShape, random_shape
from stages.ingest.roboart.catalogue import robot_entry

logger = logging.getLogger(__name__)
TRAINING, VALIDATION = 0, 1  # streams of random numbers


class PairSource:
    """Training pairs by number. Pair i is the same in every process and run.

    Robots are read at the first pair, so that the source can be sent to a worker process.
    """

    def __init__(self, config: TrainFlowConfig, assets: Path | None = None) -> None:
        self.config = config
        self.assets = assets
        self.robots: list[PosableShape] | None = None

    def __getitem__(self, index: int) -> Pair:
        if self.robots is None:
            self.robots = list(robot_shapes(self.config.robots, self.assets).values())
        rng = np.random.default_rng((self.config.seed, TRAINING, index))
        of_robot = self.robots and rng.random() < self.config.robot_share
        shape = self.robots[rng.integers(len(self.robots))] if of_robot else random_shape(rng)
        return make_pair(shape, self.config, rng)


def check_robots(config: TrainFlowConfig) -> None:
    """Raise InputError for an unknown robot, and for one that is used both for training and for validation."""
    for name in (*config.robots, *config.validation_robots):
        robot_entry(name)
    if both := sorted(set(config.robots) & set(config.validation_robots)):
        raise InputError(
            f"validation_robots: found {both[0]!r}, which is trained on, expected others; take it out of one"
        )


def robot_shapes(names: Sequence[str], assets: Path | None) -> dict[str, PosableShape]:
    """The available ones of the named robots. A warning names the others."""
    found = {}
    for name in names:
        try:
            found[name] = robot_shape(name, assets)
        except UnavailableError as error:
            logger.warning("left out: %s", error)
    return found


def validation_pairs(config: TrainFlowConfig, assets: Path | None) -> list[Pair]:
    """Validation pairs: of robots that are never trained on, in turn, or of random shapes if no robot is available."""
    robots = list(robot_shapes(config.validation_robots, assets).values())
    pairs = []
    for index in range(config.validation_pairs):
        rng = np.random.default_rng((config.seed, VALIDATION, index))
        pairs.append(make_pair(robots[index % len(robots)] if robots else random_shape(rng), config, rng))
    return pairs
