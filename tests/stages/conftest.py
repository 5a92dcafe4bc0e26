"""A tiny two-part object whose answer is known: a box with a lid that turns, or a drawer that slides; and its fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from schemas.flow import Flow
from schemas.joints import PRISMATIC, REVOLUTE, JointKind
from schemas.kinematic import KinematicModel
from schemas.model_file import Result
from schemas.sequence import PointSequence
from stages.kernels.kinematics.tree import joint_transforms
from stages.kernels.points.nearest import KDTree, nearest
from stages.result.stage import compute_result

FRAMES, POINTS = 5, 400
STATES = np.array([-0.5, -0.25, 0.0, 0.3, 0.6])
CANONICAL = 2
AWAY = (694386.212, 5155487.512, 381.036)  # geo-referenced coordinates


@dataclass(frozen=True)
class TwoParts:
    """A sequence in the normalised frame with its truth; part 0 stands still, part 1 moves by `states` (frames, 1)."""

    sequence: PointSequence
    labels: list[np.ndarray]
    kind: JointKind
    Ts_frame_canonical: np.ndarray
    axis: np.ndarray
    point: np.ndarray
    states: np.ndarray

    @property
    def canonical_labels(self) -> np.ndarray:
        return self.labels[CANONICAL]

    def true_flow(self) -> Flow:
        """Exact flow at mutual nearest neighbours under the true motion."""
        frames = self.sequence.frames()
        columns = []
        for t in range(FRAMES - 1):
            T_step = self.Ts_frame_canonical[t + 1] @ np.linalg.inv(self.Ts_frame_canonical[t])
            T_points = T_step[self.labels[t]]
            warped = np.einsum("nij,nj->ni", T_points[:, :3, :3], frames[t]) + T_points[:, :3, 3]
            target = nearest(KDTree(frames[t + 1]), warped)[1]
            columns.append((np.arange(len(warped)), target, warped - frames[t], np.ones(len(warped))))
        source, target, flow, confidence = (np.concatenate(column) for column in zip(*columns, strict=True))
        counts = np.array([len(column[0]) for column in columns], dtype=np.int64)
        return Flow(
            pair_frames=np.stack([np.arange(FRAMES - 1), np.arange(1, FRAMES)], axis=1),
            pair_costs=np.zeros(FRAMES - 1),
            match_counts=counts,
            source_index=source,
            target_index=target,
            flow=flow,
            confidence=confidence,
        )


def box_surface(rng: np.random.Generator, count: int, low: list[float], high: list[float]) -> np.ndarray:
    """Points spread evenly over a box's surface."""
    low_corner, size = np.array(low), np.array(high) - np.array(low)
    areas = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]]).repeat(2)
    face = rng.choice(6, size=count, p=areas / areas.sum())
    p = rng.uniform(size=(count, 3))
    p[np.arange(count), face // 2] = face % 2
    return low_corner + p * size


def two_parts(kind: str) -> TwoParts:
    axis = np.array([0.0, 1.0, 0.0])
    point = np.array([0.0, 0.0, 0.05]) if kind == "hinge" else np.zeros(3)
    joint = REVOLUTE if kind == "hinge" else PRISMATIC
    states = (STATES if kind == "hinge" else 0.4 * STATES)[:, None]
    Ts = np.tile(np.eye(4), (FRAMES, 2, 1, 1))
    Ts[:, 1] = joint_transforms(point, states @ joint.basis(axis))
    frames, labels = [], []
    for t in range(FRAMES):
        rng = np.random.default_rng(t)
        body = box_surface(rng, POINTS // 2, [-0.45, -0.2, -0.1], [-0.06, 0.2, 0.1])
        lid = box_surface(rng, POINTS // 2, [0.06, -0.15, -0.03], [0.4, 0.15, 0.06])
        frames.append(np.concatenate([body, lid @ Ts[t, 1, :3, :3].T + Ts[t, 1, :3, 3]]))
        labels.append(np.repeat([0, 1], POINTS // 2))
    sequence = PointSequence(
        points=np.concatenate(frames),
        point_counts=np.full(FRAMES, POINTS),
        dropped_counts=np.zeros(FRAMES, dtype=np.int64),
        scale=2.0,
        centre=(1.0, 0.0, -1.0),
        units="metre",
        frame_names=tuple(f"frame_{t}" for t in range(FRAMES)),
    )
    return TwoParts(sequence, labels, joint, Ts, axis, point, states)


@pytest.fixture(scope="session")
def hinge() -> TwoParts:
    return two_parts("hinge")


@pytest.fixture(scope="session")
def drawer() -> TwoParts:
    return two_parts("drawer")


@pytest.fixture(params=["hinge", "drawer"])
def two_part_object(request: pytest.FixtureRequest) -> TwoParts:
    return request.getfixturevalue(request.param)


def fitted(scene: TwoParts, free: bool = False) -> Result:
    """The true model, standing still or on a moving base."""
    Ts = scene.Ts_frame_canonical.copy()
    if free:
        along = np.linspace(-0.1, 0.1, scene.sequence.frame_count)[:, None]
        tilt = np.array([0.6, 0.0, 0.8])
        Ts = joint_transforms(np.zeros(3), along * np.concatenate([3 * tilt, tilt]))[:, None] @ Ts
    model = KinematicModel(
        canonical_frame=CANONICAL,
        root=0,
        labels=scene.canonical_labels,
        Ts_frame_canonical=Ts,
        joint_parent=np.array([0]),
        joint_child=np.array([1]),
        joint_types=(scene.kind.name,),
        axis=scene.axis[None],
        point=scene.point[None],
        states=scene.states,
        e_spatial=np.zeros(1),
        e_1dof=np.zeros(1),
        energies={},
    )
    return compute_result(model, scene.sequence)


def placed(scene: TwoParts, centre: tuple[float, float, float]) -> TwoParts:
    """The same, half a metre large and elsewhere."""
    return replace(scene, sequence=scene.sequence.replace(scale=0.5, centre=centre))


@pytest.fixture
def fit_of() -> Callable[..., Result]:
    return fitted


@pytest.fixture(params=["hinge", "drawer", "hinge on a moving base"])
def near_and_far(request: pytest.FixtureRequest) -> list[tuple[TwoParts, Result]]:
    """The same object and its fit near the origin, and thousands of kilometres away."""
    name, _, moving = request.param.partition(" ")
    scenes = [placed(request.getfixturevalue(name), centre) for centre in ((0.0, 0.0, 0.0), AWAY)]
    return [(scene, fitted(scene, bool(moving))) for scene in scenes]


@pytest.fixture
def away() -> np.ndarray:
    """Where the far one lies, seen from the near one."""
    return np.array(AWAY)
