"""Objects with their true trees, as the final fit's own working state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from schemas.config import FinalFitConfig
from schemas.joints import PRISMATIC, REVOLUTE
from stages.final_fit.working import Fit, Frames
from stages.kernels.alignment.registration import Registration
from stages.kernels.kinematics.chain import Chain, Joint

CANONICAL = 2
FIRST, SECOND = np.array([0.3, 0.2, 0.0, 0.1, 0.4]), np.array([0.1, 0.4, 0.0, 0.3, 0.0])  # what `slides` moves by


@dataclass(frozen=True)
class Case:
    """Frames, and the labels and the tree that made them."""

    frames: Frames
    fit: Fit

    @property
    def chain(self) -> Chain:
        return self.fit.chain

    @property
    def labels(self) -> np.ndarray:
        return self.fit.labels

    def moved(self, Ts: np.ndarray) -> Case:
        """The same, with the whole object moved by Ts (frames, 4, 4)."""
        clouds = [p @ T[:3, :3].T + T[:3, 3] for p, T in zip(self.frames.registration.frames, Ts, strict=True)]
        frames = replace(self.frames, registration=Registration(clouds, CANONICAL), p_all=clouds[CANONICAL])
        return Case(frames, Fit(Chain.of(self.chain.joints(), self.chain.tree.root, Ts, free_root=True), self.labels))


def still(frames: int) -> np.ndarray:
    return np.tile(np.eye(4), (frames, 1, 1))


def case(clouds: list[np.ndarray], labels: np.ndarray, chain: Chain) -> Case:
    frames = Frames(
        Registration(clouds, CANONICAL), clouds[CANONICAL], np.arange(len(labels)), CANONICAL, FinalFitConfig()
    )
    return Case(frames, Fit(chain, labels))


def two_part_case(truth) -> Case:
    joint = Joint(truth.kind, 0, 1, truth.axis, truth.point, truth.states)
    chain = Chain.of([joint], 0, still(len(truth.states)), free_root=False)
    return case(truth.sequence.frames(), truth.canonical_labels, chain)


@pytest.fixture(scope="session")
def hinge_case(hinge) -> Case:
    return two_part_case(hinge)


@pytest.fixture(scope="session")
def drawer_case(drawer) -> Case:
    return two_part_case(drawer)


@pytest.fixture(params=["hinge_case", "drawer_case"])
def two_parts(request: pytest.FixtureRequest) -> Case:
    return request.getfixturevalue(request.param)


def box(rng: np.random.Generator, count: int, low: list[float], high: list[float]) -> np.ndarray:
    size = np.array(high) - np.array(low)
    areas = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]]).repeat(2)
    face = rng.choice(6, size=count, p=areas / areas.sum())
    p = rng.uniform(size=(count, 3))
    p[np.arange(count), face // 2] = face % 2
    return np.array(low) + p * size


def cylinder(rng: np.random.Generator, count: int, radius: float, height: float) -> np.ndarray:
    """A closed cylinder about the z axis."""
    angle, z = rng.uniform(0, 2 * np.pi, count), rng.uniform(-height / 2, height / 2, count)
    cap = rng.uniform(size=count) < radius / (radius + height)
    z[cap] = height / 2 * np.sign(z[cap])
    r = radius * np.where(cap, np.sqrt(rng.uniform(size=count)), 1.0)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


@pytest.fixture(scope="session")
def housed() -> Case:
    """Body (0), a round housing (1) that turns about its own axis z, and an arm (2) that turns on it about y."""
    states = np.array([[-0.6, 0.5, 0.0, -0.2, 0.4, -0.5, 0.7], [0.5, 0.6, 0.0, -0.4, -0.6, -0.3, 0.3]])
    axis = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    joints = [Joint(REVOLUTE, k, k + 1, axis[k], np.zeros(3), states[k][:, None]) for k in (0, 1)]
    chain = Chain.of(joints, 0, still(states.shape[1]), free_root=False)
    counts = [400, 150, 300]
    clouds = []
    for t, Ts in enumerate(chain.Ts):
        rng = np.random.default_rng(t)
        parts = (
            box(rng, counts[0], [-0.3, -0.25, -0.4], [0.3, 0.25, -0.13]),
            cylinder(rng, counts[1], 0.1, 0.24),
            box(rng, counts[2], [0.12, -0.08, -0.06], [0.6, 0.08, 0.06]),
        )
        clouds.append(np.concatenate([p @ T[:3, :3].T + T[:3, 3] for p, T in zip(parts, Ts, strict=True)]))
    return case(clouds, np.repeat([0, 1, 2], counts), chain)


@pytest.fixture(scope="session")
def slides():
    """Three boxes of given corners: part 0 keeps still, part 1 slides on it along y, and part 2 on part 1, along an
    axis at an angle of `turn` to that; against part 0 they move by FIRST and, for no turn, SECOND."""

    def slides_of(corners, turn: float = 0.0) -> Case:
        axis = np.array([[0.0, 1.0, 0.0], [0.0, np.cos(turn), np.sin(turn)]])
        states = np.stack([FIRST, SECOND - FIRST])
        joints = [Joint(PRISMATIC, k, k + 1, axis[k], np.zeros(3), states[k][:, None]) for k in (0, 1)]
        chain = Chain.of(joints, 0, still(5), free_root=False)
        counts, clouds = [500, 250, 250], []
        for t, Ts in enumerate(chain.Ts):
            rng = np.random.default_rng(t)
            boxes = zip(counts, corners, Ts, strict=True)
            clouds.append(np.concatenate([box(rng, count, *low_high) + T[:3, 3] for count, low_high, T in boxes]))
        return case(clouds, np.arange(3).repeat(counts), chain)

    return slides_of
