"""Small artifacts of every schema, degenerate ones included."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from schemas.artifact import Artifact
from schemas.assessment import Assessment, Evidence, Spread, Verdict
from schemas.flow import Flow
from schemas.kinematic import Candidate, CanonicalChoice, KinematicModel
from schemas.metrics import JointMetrics, Metrics
from schemas.model_file import ModelFile, ModelJoint, ModelPart, Result
from schemas.relaxed import RelaxedModel
from schemas.report import Report
from schemas.robot import Robot, RobotLink, RobotMesh
from schemas.sequence import GroundTruth, IngestedSequence, PointSequence, TrueJoint, TrueSurface

FRAMES = 3


def still(*leading: int) -> np.ndarray:
    return np.tile(np.eye(4), (*leading, 1, 1))


def point_sequence() -> PointSequence:
    rng = np.random.default_rng(0)
    return PointSequence(
        points=rng.normal(size=(12, 3)),
        point_counts=np.array([5, 4, 3]),
        dropped_counts=np.array([0, 2, 0]),
        scale=1.7,
        centre=(0.1, -0.2, 1e-7),
        units="metre",
        frame_names=("a.ply", "b.ply", "c.ply"),
    )


def ground_truth() -> GroundTruth:
    return GroundTruth(
        labels=np.array([0, 1] * 6),
        Ts_frame_first=still(FRAMES, 2),
        Ts_novel_first=still(0, 2),
        parent=np.array([-1, 0]),
        part_names=("base", "lid"),
        joints=(
            TrueJoint(
                name="hinge",
                parent=0,
                child=1,
                type="revolute",
                axis=(0.0, 0.0, 1.0),
                point=(0.0, 0.0, 0.0),
                states=(0.0, 0.1, 0.2),
            ),
        ),
    )


def true_surface() -> TrueSurface:
    rng = np.random.default_rng(2)
    return TrueSurface(
        vertices=rng.normal(size=(FRAMES, 7, 3)),
        corners=rng.integers(7, size=(12, 3)),
        weights=np.tile([0.2, 0.3, 0.5], (12, 1)),
    )


def flow(matches: int = 4) -> Flow:
    rng = np.random.default_rng(1)
    return Flow(
        pair_frames=np.array([[0, 1], [1, 2]]),
        pair_costs=np.array([0.1, 0.2]),
        match_counts=np.array([matches, 0]),
        source_index=np.arange(matches),
        target_index=np.arange(matches)[::-1].copy(),
        flow=rng.normal(size=(matches, 3)),
        confidence=np.ones(matches),
    )


def kinematic_model() -> KinematicModel:
    """Three parts in a chain: a hinge and a slider."""
    return KinematicModel(
        canonical_frame=1,
        root=0,
        labels=np.array([0, 1, 2, 2]),
        Ts_frame_canonical=still(FRAMES, 3),
        joint_parent=np.array([0, 1]),
        joint_child=np.array([1, 2]),
        joint_types=("revolute", "prismatic"),
        axis=np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
        point=np.zeros((2, 3)),
        states=np.array([[0.0, 0.0], [0.1, 0.1], [-0.2, -0.2]]),
        e_spatial=np.array([0.1, 0.2]),
        e_1dof=np.array([1e-300, 0.3]),
        energies={"E_project": 0.1 + 0.2, "E_group": float("inf")},
    )


def single_part() -> KinematicModel:
    """No joint at all."""
    return KinematicModel(
        canonical_frame=0,
        root=0,
        labels=np.zeros(4, dtype=np.int64),
        Ts_frame_canonical=still(FRAMES, 1),
        joint_parent=np.zeros(0, dtype=np.int64),
        joint_child=np.zeros(0, dtype=np.int64),
        joint_types=(),
        axis=np.zeros((0, 3)),
        point=np.zeros((0, 3)),
        states=np.zeros((FRAMES, 0)),
        e_spatial=np.zeros(0),
        e_1dof=np.zeros(0),
        energies={},
    )


def metrics() -> Metrics:
    joint = JointMetrics(name="hinge", true_type="revolute", predicted_type=None)
    return Metrics(
        units="metre", diagonal=1.7, canonical_frame=1, parts_found=3, chamfer_percent=0.5, ari=0.9, joints=(joint,)
    )


def assessment() -> Assessment:
    return Assessment(
        spreads=(Spread(direction=0.01, place=0.002), Spread(direction=0.02)),
        evidence=Evidence(
            excess=np.array([1.2, 1.0, 1.1]),
            unexplained=np.array([0.1, 0.0, 0.01]),
            firmness=np.array([1.0, 0.9, -0.1]),
            open_share=0.3,
        ),
        verdict=Verdict(trust="poor", reasons=("30 % of the points could belong to another part",)),
    )


def result() -> Result:
    joint = ModelJoint(
        id=0,
        name="joint_0_1",
        parent=0,
        child=1,
        type="spherical",
        axis=(0.0, 0.0, 1.0),
        point=(0.0, 0.0, 0.0),
        lower=0.0,
        upper=0.5,
        states=((0.0, 0.0, 0.0), (0.1, 0.2, 0.3), (0.0, 0.5, 0.0)),
    )
    parts = tuple(ModelPart(id=i, name=f"part_{i}", point_count=2) for i in range(2))
    return Result(
        model=ModelFile(units="unknown", frames=FRAMES, canonical_frame=0, root=0, parts=parts, joints=(joint,)),
        canonical_points=np.ones((4, 3), dtype=np.float32),
        labels=np.array([0, 0, 1, 1]),
        T_frame_canonical=still(FRAMES, 2),
    )


def relaxed_model() -> RelaxedModel:
    return RelaxedModel(
        canonical_frame=1,
        labels=np.array([0, 1, 1, 0]),
        Ts_frame_canonical=still(FRAMES, 2),
        energy_history=np.array([[4.0, 1.0, 2.0, 1.0], [3.0, 1.0, 1.0, 1.0]]),
        solver="gumbel",
        iterations=2,
    )


def robot() -> Robot:
    """One link, a tetrahedron."""
    return Robot(
        name="tetrahedron",
        metres_per_unit=1.0,
        size=1.7,
        units="metre",
        canonical_frame=0,
        root=0,
        free_base=False,
        density=1000.0,
        links=(
            RobotLink(
                name="part_0",
                points=4,
                origin=(0, 0, 0),
                mass=1.0,
                centre=(0, 0, 0),
                inertia=(1, 1, 1, 0, 0, 0),
                solid="mesh",
            ),
        ),
        joints=(),
        meshes=(RobotMesh(link=0, role="visual", file="meshes/part_0.stl", vertices=4, triangles=4, closed=True),),
        vertices=np.eye(4, 3),
        triangles=np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
        touching=np.zeros((0, 2), dtype=np.int64),
        T_frame_root=still(FRAMES),
    )


SAMPLES: dict[str, Callable[[], Artifact]] = {
    "sequence": point_sequence,
    "coloured_sequence": lambda: point_sequence().replace(colours=np.arange(36, dtype=np.uint8).reshape(12, 3)),
    "seen_sequence": lambda: point_sequence().replace(viewpoints=np.random.default_rng(5).normal(size=(FRAMES, 2, 3))),
    "truth": ground_truth,
    "ingested": lambda: IngestedSequence(sequence=point_sequence(), truth=ground_truth()),
    "ingested_surface": lambda: IngestedSequence(sequence=point_sequence(), surface=true_surface()),
    "ingested_without_truth": lambda: IngestedSequence(sequence=point_sequence()),
    "flow": flow,
    "flow_without_matches": lambda: flow(0),
    "relaxed": relaxed_model,
    "kinematic": kinematic_model,
    "single_part": single_part,
    "choice": lambda: CanonicalChoice(
        candidates=(Candidate(frame=1, parts=3, e_project=0.1, e_group=0.2, e_fit=0.3),), model=kinematic_model()
    ),
    "metrics": metrics,
    "result": result,
    "robot": robot,
    "assessment": assessment,
    "report": lambda: Report(residuals=np.array([[0.0, 0.0], [0.5, 0.6], [0.4, 2.0]]), sampling=0.45),
}


@pytest.fixture(params=SAMPLES)
def sample(request: pytest.FixtureRequest) -> Artifact:
    """Each of the small artifacts in turn."""
    return SAMPLES[request.param]()


@pytest.fixture
def samples() -> dict[str, Artifact]:
    """All of the small artifacts by name."""
    return {name: make() for name, make in SAMPLES.items()}
