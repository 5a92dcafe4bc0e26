"""Objects with their true models, as an assessment sees them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from schemas.kinematic import KinematicModel
from schemas.sequence import PointSequence
from stages.kernels.kinematics.tree import joint_transforms

FRAMES, CANONICAL = 5, 2
STATES = np.array([-0.5, -0.25, 0.0, 0.3, 0.6])


def sequence_of(frames: list[np.ndarray]) -> PointSequence:
    return PointSequence(
        points=np.concatenate(frames),
        point_counts=np.array([len(frame) for frame in frames]),
        dropped_counts=np.zeros(len(frames), dtype=np.int64),
        scale=2.0,
        centre=(0.0, 0.0, 0.0),
        units="metre",
        frame_names=tuple(f"scan_{t}.ply" for t in range(len(frames))),
    )


def model_of(Ts: np.ndarray, labels: np.ndarray, kind: str, axis: np.ndarray, point: np.ndarray, states: np.ndarray):
    return KinematicModel(
        canonical_frame=CANONICAL,
        root=0,
        labels=labels,
        Ts_frame_canonical=Ts,
        joint_parent=np.array([0]),
        joint_child=np.array([1]),
        joint_types=(kind,),
        axis=axis[None],
        point=point[None],
        states=states[:, None],
        e_spatial=np.zeros(1),
        e_1dof=np.zeros(1),
        confidence=np.ones((1, 3)),
        energies={},
    )


@pytest.fixture(scope="session")
def hinged(hinge) -> tuple[KinematicModel, PointSequence]:
    """A box with a lid that turns."""
    model = model_of(
        hinge.Ts_frame_canonical, hinge.canonical_labels, "revolute", hinge.axis, hinge.point, hinge.states[:, 0]
    )
    return model, hinge.sequence


@pytest.fixture(scope="session")
def sliding(drawer) -> tuple[KinematicModel, PointSequence]:
    """A box with a drawer."""
    model = model_of(
        drawer.Ts_frame_canonical, drawer.canonical_labels, "prismatic", drawer.axis, drawer.point, drawer.states[:, 0]
    )
    return model, drawer.sequence


@pytest.fixture(scope="session")
def round_cap() -> tuple[KinematicModel, PointSequence]:
    """A bottle with a cap as wide as itself that turns about their common axis: nothing tells where the cap begins."""
    axis, point = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    Ts = np.tile(np.eye(4), (FRAMES, 2, 1, 1))
    Ts[:, 1] = joint_transforms(point, STATES[:, None] * np.concatenate([axis, np.zeros(3)]))
    frames, labels = [], []
    for t in range(FRAMES):
        rng = np.random.default_rng(t)
        angle, z = rng.uniform(0, 2 * np.pi, 900), rng.uniform(-0.4, 0.4, 900)
        frames.append(np.stack([0.15 * np.cos(angle), 0.15 * np.sin(angle), z], axis=1))
        labels.append((z > 0.25).astype(np.int64))
    return model_of(Ts, labels[CANONICAL], "revolute", axis, point, STATES), sequence_of(frames)


Change = Callable[[list[np.ndarray]], list[np.ndarray]]


@pytest.fixture
def changed() -> Callable[[PointSequence, Change], PointSequence]:
    """A sequence whose frames are changed."""

    def of(sequence: PointSequence, change: Change) -> PointSequence:
        frames = change([frame.copy() for frame in sequence.frames()])
        return sequence.replace(points=np.concatenate(frames), point_counts=np.array([len(frame) for frame in frames]))

    return of
