from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from schemas.assessment import Assessment, Evidence, Spread, Verdict
from schemas.config import EvaluationConfig
from schemas.kinematic import KinematicModel
from schemas.metrics import Metrics
from schemas.sequence import NO_PART, GroundTruth, IngestedSequence, PointSequence, TrueJoint, TrueSurface
from stages.evaluation.stage import chamfer_distance, compute_evaluation, joint_errors, line_distance
from stages.evaluation.summary import figures_of

FRAMES, PER_PART, CANONICAL = 5, 60, 3
PARENT = [-1, 0, 1, 0]
"""A body with an arm of two links and a drawer; every joint's state is zero in frame 0."""
CENTRE = np.array([[0.0, 0, 0], [0.2, 0, 0], [0.35, 0.1, 0], [-0.2, 0, 0]])
AXIS = np.array([[0.0, 0, 1], [0.6, 0, 0.8], [0, 1, 0]])
POINT = np.array([[0.1, 0.02, 0], [0.3, 0.05, 0], [-0.1, 0, 0]])
TYPES = ("revolute", "revolute", "prismatic")
STATES = np.array([[0, 0.2, 0.4, 0.7, 1.0], [0, -0.3, -0.5, -0.6, -0.8], [0, 0.02, 0.05, 0.08, 0.1]])
NOVEL = np.array([[-0.5, 1.4], [0.7, 0.3], [-0.04, 0.15]])


def joint_motion(joint: int, state: float, axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    if TYPES[joint] == "prismatic":
        T[:3, 3] = state * axis
    else:
        T[:3, :3] = Rotation.from_rotvec(state * axis).as_matrix()
        T[:3, 3] = point - T[:3, :3] @ point
    return T


def pose(states: np.ndarray, axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    Ts = [np.eye(4)]
    for joint in range(3):
        Ts.append(Ts[PARENT[joint + 1]] @ joint_motion(joint, states[joint], axis[joint], point[joint]))
    return np.stack(Ts)


def poses(states: np.ndarray, axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    return np.stack([pose(state, axis, point) for state in states.T])


def moved(Ts: np.ndarray, labels: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", Ts[labels, :3, :3], p) + Ts[labels, :3, 3]


def ingested(units: str = "metre", scale: float = 2.0) -> IngestedSequence:
    rng = np.random.default_rng(0)
    Ts = poses(STATES, AXIS, POINT)
    labels = np.stack([rng.permutation(np.repeat(np.arange(4), PER_PART)) for _ in range(FRAMES)])
    frames = [moved(Ts[t], labels[t], CENTRE[labels[t]] + rng.uniform(-0.07, 0.07, (240, 3))) for t in range(FRAMES)]
    sequence = PointSequence(
        points=np.concatenate(frames),
        point_counts=np.full(FRAMES, 4 * PER_PART),
        dropped_counts=np.zeros(FRAMES, dtype=np.int64),
        scale=scale,
        centre=(3.0, -1.0, 0.5),
        units=units,
        frame_names=tuple(f"frame_{t}" for t in range(FRAMES)),
    )
    joints = tuple(
        TrueJoint(
            name=f"joint {j}",
            parent=PARENT[j + 1],
            child=j + 1,
            type=TYPES[j],
            axis=tuple(AXIS[j]),
            point=tuple(POINT[j]),
            states=tuple(STATES[j] + 0.25),  # its zero is elsewhere
        )
        for j in range(3)
    )
    truth = GroundTruth(
        labels=labels.ravel(),
        Ts_frame_first=Ts,
        Ts_novel_first=poses(NOVEL, AXIS, POINT),
        parent=np.array(PARENT),
        part_names=("body", "upper arm", "forearm", "drawer"),
        joints=joints,
    )
    return IngestedSequence(sequence=sequence, truth=truth)


def true_model(data: IngestedSequence) -> KinematicModel:
    """The model that is exactly right: axes carried to the canonical frame, states since then."""
    truth = data.truth
    T_canonical_first = truth.Ts_frame_first[CANONICAL][PARENT[1:]]
    axis = np.einsum("jab,jb->ja", T_canonical_first[:, :3, :3], AXIS)
    point = moved(T_canonical_first, np.arange(3), POINT)
    point -= axis * (axis * point).sum(1, keepdims=True)
    return KinematicModel(
        canonical_frame=CANONICAL,
        root=0,
        labels=truth.labels.reshape(FRAMES, -1)[CANONICAL],
        Ts_frame_canonical=truth.Ts_frame_first @ np.linalg.inv(truth.Ts_frame_first[CANONICAL]),
        joint_parent=np.array(PARENT[1:]),
        joint_child=np.arange(1, 4),
        joint_types=TYPES,
        axis=axis,
        point=point,
        states=(STATES - STATES[:, [CANONICAL]]).T,
        e_spatial=np.zeros(3),
        e_1dof=np.zeros(3),
        energies={},
    )


def measured(model: KinematicModel, data: IngestedSequence, seed: int = 0) -> Metrics:
    return compute_evaluation(model, data, EvaluationConfig(), np.random.default_rng(seed))


def with_truth(data: IngestedSequence, **changes: Any) -> IngestedSequence:
    return data.replace(truth=data.truth.replace(**changes))


def test_where_nothing_moves_no_part_is_observable() -> None:
    data = ingested()
    still = with_truth(data, Ts_frame_first=np.tile(np.eye(4), (FRAMES, 4, 1, 1)))
    metrics = measured(true_model(data), still)
    assert (metrics.told_share, metrics.ari_told) == (0, None)
    assert metrics.untold_parts == data.truth.part_names


def test_the_true_model_is_perfect() -> None:
    data = ingested()
    metrics = measured(true_model(data), data)
    assert (metrics.parts_found, metrics.parts_true, metrics.tree_edit_distance) == (4, 4, 0)
    assert (metrics.ari, metrics.ri, metrics.acc5, metrics.acc10, metrics.joint_type_accuracy) == (1, 1, 1, 1, 1)
    assert metrics.recon == pytest.approx(0, abs=1e-12)
    assert metrics.epe == pytest.approx(0, abs=1e-12)
    assert metrics.reanimation_percent == pytest.approx(0, abs=0.01)
    assert [joint.predicted_type for joint in metrics.joints] == list(TYPES)
    for joint in metrics.joints:
        assert joint.axis_angle_deg == pytest.approx(0, abs=1e-5)
        assert joint.state_error == pytest.approx(0, abs=1e-9)
    assert [joint.axis_distance_percent for joint in metrics.joints] == [
        pytest.approx(0, abs=1e-5),
        pytest.approx(0, abs=1e-5),
        None,
    ]


def test_renumbered_parts_and_a_reversed_joint_change_no_joint_error() -> None:
    data = ingested()
    model = true_model(data)
    new = np.array([2, 0, 3, 1])
    states = model.states.copy()
    states[:, 1] *= -1  # about the opposite axis the same motion has the opposite angle
    axis = model.axis.copy()
    axis[1] *= -1
    # The upper arm as root: joint 0 now moves the body; the motion of parent against child is the inverse.
    states[:, 0] *= -1
    model = model.replace(
        labels=new[model.labels],
        Ts_frame_canonical=model.Ts_frame_canonical[:, np.argsort(new)],
        root=int(new[1]),
        joint_parent=new[[1, 1, 0]],
        joint_child=new[[0, 2, 3]],
        axis=axis,
        states=states,
    )
    metrics = measured(model, data)
    assert metrics.ari == 1
    assert metrics.recon == pytest.approx(0, abs=1e-12)
    for joint in metrics.joints:
        assert joint.axis_angle_deg == pytest.approx(0, abs=1e-5)
        assert joint.state_error == pytest.approx(0, abs=1e-9)
    assert metrics.joint_type_accuracy == 1


def test_recon_and_epe_of_a_part_that_is_displaced_in_one_frame() -> None:
    data = ingested(scale=2.0)
    model = true_model(data)
    Ts = model.Ts_frame_canonical.copy()
    Ts[1, 3, :3, 3] += [0.03, 0, 0.04]
    metrics = measured(model.replace(Ts_frame_canonical=Ts), data)
    assert metrics.recon_percent == pytest.approx(100 * 0.05 / (4 * FRAMES))
    assert metrics.recon == pytest.approx(2.0 * 0.05 / (4 * FRAMES))
    assert metrics.epe_percent == pytest.approx(100 * 0.05 * 2 / (4 * (FRAMES - 1)))
    assert metrics.epe == pytest.approx(2.0 * 0.05 * 2 / (4 * (FRAMES - 1)))
    assert metrics.acc10 == pytest.approx(1 - 2 / (4 * (FRAMES - 1)))


@pytest.mark.parametrize(
    ("units", "scale", "error", "acc5", "acc10"),
    [
        ("metre", 2.0, 0.0049, 1.0, 1.0),
        ("metre", 2.0, 0.0051, 0.75, 1.0),
        ("metre", 2.0, 0.0101, 0.75, 0.75),
        ("centimetre", 50.0, 0.49, 1.0, 1.0),
        ("centimetre", 50.0, 0.51, 0.75, 1.0),
        ("millimetre", 800.0, 4.9, 1.0, 1.0),
        ("millimetre", 800.0, 10.1, 0.75, 0.75),
        ("unknown", 8.0, 0.0049 * 8, 1.0, 1.0),
        ("unknown", 8.0, 0.0051 * 8, 0.75, 1.0),
        ("unknown", 8.0, 0.0101 * 8, 0.75, 0.75),
    ],
)
def test_flow_is_accurate_within_5_and_10_millimetres(
    units: str, scale: float, error: float, acc5: float, acc10: float
) -> None:
    data = ingested(units, scale)
    model = true_model(data)
    Ts = model.Ts_frame_canonical.copy()
    Ts[:, 0, 2, 3] += np.arange(FRAMES) * error / scale  # the body stands still, so its flow's length is zero
    metrics = measured(model.replace(Ts_frame_canonical=Ts), data)
    assert (metrics.acc5, metrics.acc10) == (acc5, acc10)


def test_flow_is_accurate_within_a_share_of_its_length() -> None:
    data = ingested("metre", 1000.0)  # so large that 10 mm are nothing
    drawer_step = STATES[2, 2] - STATES[2, 1]
    for share, acc5, acc10 in ((0.0049, 1.0, 1.0), (0.0051, 15 / 16, 1.0), (0.0101, 15 / 16, 15 / 16)):
        model = true_model(data)
        Ts = model.Ts_frame_canonical.copy()
        Ts[2:, 3, 0, 3] += share * drawer_step  # one part of four, one step of four
        metrics = measured(model.replace(Ts_frame_canonical=Ts), data)
        assert (metrics.acc5, metrics.acc10) == (acc5, acc10)


def test_axis_errors_are_the_angle_and_the_distance_that_were_put_in() -> None:
    data = ingested()
    model = true_model(data)
    axis, point = model.axis.copy(), model.point.copy()
    across = np.cross(axis[0], [1.0, 0, 0])
    point[0] += 0.03 * across / np.linalg.norm(across)
    side = np.cross(axis[1], [0.0, 1, 0])
    tilt = Rotation.from_rotvec(math.radians(10) * side / np.linalg.norm(side)).as_matrix()
    axis[1] = tilt @ axis[1]
    metrics = measured(model.replace(axis=axis, point=point), data)
    assert metrics.joints[0].axis_distance_percent == pytest.approx(3)
    assert metrics.joints[0].axis_angle_deg == pytest.approx(0, abs=1e-5)
    assert metrics.joints[1].axis_angle_deg == pytest.approx(10)


def test_state_error_is_in_radians_or_percent_of_the_diagonal() -> None:
    data = ingested()
    model = true_model(data)
    states = model.states.copy()
    states[0, 0] += 0.1
    states[0, 1] += 2 * np.pi  # a whole turn more is the same pose
    states[4, 2] -= 0.02
    metrics = measured(model.replace(states=states), data)
    assert [joint.state_error for joint in metrics.joints] == [
        pytest.approx(0.1 / FRAMES),
        pytest.approx(0, abs=1e-9),
        pytest.approx(2.0 / FRAMES),
    ]


def test_a_wrong_joint_type_has_no_state_error_and_counts_against_the_accuracy() -> None:
    data = ingested()
    model = true_model(data)
    states = model.states.copy()
    states[:, 1] = 0
    metrics = measured(model.replace(joint_types=("revolute", "prismatic", "prismatic"), states=states), data)
    assert metrics.joint_type_accuracy == pytest.approx(2 / 3)
    assert metrics.joints[1].state_error is None
    assert metrics.joints[1].axis_distance_percent is None
    assert metrics.joints[1].axis_angle_deg == pytest.approx(0, abs=1e-5)


def test_a_true_joint_whose_parts_are_not_linked_is_unmatched() -> None:
    data = ingested()
    metrics = measured(true_model(data).replace(joint_parent=np.array([0, 0, 0])), data)
    assert [joint.predicted_type for joint in metrics.joints] == ["revolute", None, "prismatic"]
    assert metrics.joints[1].axis_angle_deg is None
    assert metrics.joint_type_accuracy == 1
    assert metrics.tree_edit_distance == 2


def test_confidence_is_told_of_matched_joints_and_judged_for_all() -> None:
    data = ingested()
    model = true_model(data).replace(joint_parent=np.array([0, 0, 0]))
    assert measured(model, data).verdicts == ()
    assert measured(model, data).joints[0].confidence is None
    metrics = measured(model.replace(confidence=np.array([[0.9, 0.8, 1], [0.1, 1, 1], [1, 0.6, 0.7]])), data)
    assert [joint.confidence for joint in metrics.joints] == [0.8, None, 0.6]
    assert [(verdict.confidence, verdict.right) for verdict in metrics.verdicts] == [
        (0.8, True),
        (0.1, False),
        (0.6, True),
    ]


def test_without_true_joints_no_confidence_is_judged() -> None:
    data = ingested()
    model = true_model(data).replace(confidence=np.ones((3, 3)))
    assert measured(model, with_truth(data, joints=())).verdicts == ()
    assert measured(model, data.replace(truth=None)).verdicts == ()


def test_merged_parts_cost_recon_and_reanimation_and_lose_their_joint() -> None:
    data = ingested()
    model = true_model(data)
    model = model.replace(
        labels=np.array([0, 1, 1, 2])[model.labels],
        Ts_frame_canonical=model.Ts_frame_canonical[:, [0, 1, 3]],
        joint_parent=np.array([0, 0]),
        joint_child=np.array([1, 2]),
        joint_types=("revolute", "prismatic"),
        axis=model.axis[[0, 2]],
        point=model.point[[0, 2]],
        states=model.states[:, [0, 2]],
        e_spatial=np.zeros(2),
        e_1dof=np.zeros(2),
    )
    metrics = measured(model, data)
    assert [joint.predicted_type is None for joint in metrics.joints].count(True) == 1
    assert metrics.tree_edit_distance == 1
    assert metrics.recon_percent > 0.3
    assert metrics.reanimation_percent > 0.5
    assert metrics.ari < 0.8


def with_strays(data: IngestedSequence) -> IngestedSequence:
    """The same with points of no part at the end of every frame."""
    rng = np.random.default_rng(8)
    frames = [np.concatenate([p, rng.uniform(-1, 1, (30, 3))]) for p in data.sequence.frames()]
    labels = [np.concatenate([own, np.full(30, NO_PART)]) for own in data.sequence.by_frame(data.truth.labels)]
    sequence = data.sequence.replace(
        points=np.concatenate(frames), point_counts=np.array([len(frame) for frame in frames])
    )
    return IngestedSequence(sequence=sequence, truth=data.truth.replace(labels=np.concatenate(labels)))


def test_points_of_no_part_change_no_metric_but_the_chamfer_distance() -> None:
    data = ingested()
    model = true_model(data)
    model = model.replace(Ts_frame_canonical=model.Ts_frame_canonical @ shifted(0.01))
    stray = with_strays(data)
    labels = np.concatenate([model.labels, np.arange(30) % 4])
    clean, metrics = measured(model, data), measured(model.replace(labels=labels), stray)
    assert metrics.chamfer_percent > clean.chamfer_percent
    assert metrics.replace(chamfer_percent=clean.chamfer_percent) == clean


def test_where_no_point_belongs_to_a_part_only_the_chamfer_distance_is_known() -> None:
    data = ingested()
    strays = with_truth(data, labels=np.full_like(data.truth.labels, NO_PART))
    metrics = measured(true_model(data), strays)
    assert metrics.chamfer_percent == measured(true_model(data), data).chamfer_percent
    assert (metrics.ari, metrics.recon, metrics.parts_true) == (None, None, None)


def test_reanimation_depends_on_nothing_but_the_seed() -> None:
    data = ingested()
    model = true_model(data).replace(point=true_model(data).point + 0.02)
    first, second, other = (measured(model, data, seed) for seed in (1, 1, 2))
    assert first == second
    assert first.reanimation != other.reanimation
    assert first.replace(reanimation=None, reanimation_percent=None) == other.replace(
        reanimation=None, reanimation_percent=None
    )


def test_reanimation_moves_the_root_where_it_moved_in_the_sequence() -> None:
    data = ingested()
    base = np.tile(np.eye(4), (FRAMES + 2, 1, 1, 1))
    for t in range(1, FRAMES + 2):
        base[t, 0, :3, :3] = Rotation.from_rotvec([0.1 * t, -0.05 * t, 0]).as_matrix()
        base[t, 0, :3, 3] = [0.05 * t, 0, -0.02 * t]
    data = with_truth(
        data,
        Ts_frame_first=base[:FRAMES] @ data.truth.Ts_frame_first,
        Ts_novel_first=base[FRAMES:] @ data.truth.Ts_novel_first,
    )
    points = np.concatenate(
        [moved(base[t].repeat(240, 0), np.arange(240), p) for t, p in enumerate(data.sequence.frames())]
    )
    data = data.replace(sequence=data.sequence.replace(points=points))
    metrics = measured(true_model(data), data)
    assert metrics.recon == pytest.approx(0, abs=1e-12)
    assert metrics.reanimation_percent == pytest.approx(0, abs=0.02)


def placements(seed: int = 4) -> np.ndarray:
    """A rigid motion for each frame."""
    rng = np.random.default_rng(seed)
    Ts = np.tile(np.eye(4), (FRAMES, 1, 1))
    Ts[:, :3, :3] = Rotation.from_rotvec(rng.normal(size=(FRAMES, 3))).as_matrix()
    Ts[:, :3, 3] = rng.normal(size=(FRAMES, 3))
    return Ts


def in_own_coordinates(data: IngestedSequence) -> IngestedSequence:
    """The same object, each frame in coordinates of its own; unseen states are in those of frame 0."""
    Ts, truth = placements(), data.truth
    frames = [moved(T[None], np.zeros(len(p), dtype=int), p) for T, p in zip(Ts, data.sequence.frames(), strict=True)]
    home, first = np.linalg.inv(Ts[0]), Ts[0]
    joints = tuple(
        joint.model_copy(
            update={
                "axis": tuple((first[:3, :3] @ joint.axis).tolist()),
                "point": tuple((first[:3, :3] @ joint.point + first[:3, 3]).tolist()),
            }
        )
        for joint in truth.joints
    )
    own = truth.replace(
        Ts_frame_first=Ts[:, None] @ truth.Ts_frame_first @ home,
        Ts_novel_first=first @ truth.Ts_novel_first @ home,
        joints=joints,
        own_coordinates=True,
    )
    return data.replace(sequence=data.sequence.replace(points=np.concatenate(frames)), truth=own)


def carried(model: KinematicModel) -> KinematicModel:
    """The model of the shared coordinates in those of each frame's own."""
    Ts = placements()
    R, t = Ts[CANONICAL, :3, :3], Ts[CANONICAL, :3, 3]
    return model.replace(
        Ts_frame_canonical=Ts[:, None] @ model.Ts_frame_canonical @ np.linalg.inv(Ts[CANONICAL]),
        axis=model.axis @ R.T,
        point=model.point @ R.T + t,
    )


def test_the_true_model_is_perfect_where_each_frame_has_coordinates_of_its_own() -> None:
    shared = ingested()
    data = in_own_coordinates(shared)
    metrics = measured(carried(true_model(shared)), data)
    assert (metrics.ari, metrics.tree_edit_distance, metrics.acc5) == (1, 0, 1)
    for name in ("recon", "epe", "placement_percent"):
        assert getattr(metrics, name) == pytest.approx(0, abs=1e-9), name
    assert metrics.reanimation_percent == pytest.approx(0, abs=0.05)
    assert metrics.told_share == measured(true_model(shared), shared).told_share
    for joint in metrics.joints:
        assert joint.axis_angle_deg == pytest.approx(0, abs=1e-5)
        assert joint.state_error == pytest.approx(0, abs=1e-9)
    assert [joint.axis_distance_percent for joint in metrics.joints[:2]] == pytest.approx([0, 0], abs=1e-5)


def test_a_misplaced_whole_costs_the_placement_alone_where_each_frame_has_coordinates_of_its_own() -> None:
    shared = ingested()
    data, model = in_own_coordinates(shared), carried(true_model(shared))
    aside = placements(9)
    aside[CANONICAL] = np.eye(4)
    metrics = measured(model.replace(Ts_frame_canonical=aside[:, None] @ model.Ts_frame_canonical), data)
    assert metrics.placement_percent > 50
    assert metrics.recon == pytest.approx(0, abs=1e-9)
    assert metrics.epe == pytest.approx(0, abs=1e-9)
    assert metrics.reanimation_percent == pytest.approx(0, abs=0.05)
    assert measured(true_model(shared), shared).placement_percent is None


def test_errors_in_own_coordinates_are_those_in_shared_ones_after_the_best_motion_of_the_whole() -> None:
    shared = ingested()
    model = true_model(shared)
    Ts = model.Ts_frame_canonical.copy()
    Ts[1, 3, :3, 3] += [0.03, 0, 0.04]
    model = model.replace(Ts_frame_canonical=Ts)
    plain, own = measured(model, shared), measured(carried(model), in_own_coordinates(shared))
    assert own.placement_percent == pytest.approx(plain.recon_percent)
    # a quarter of the points is off by d: the best shift leaves 3/4 d of it and moves the others by 1/4 d, a turn helps
    assert 0.7 * 1.5 * plain.recon_percent < own.recon_percent < 1.5 * plain.recon_percent
    assert own.recon_percent / own.recon_of_motion_percent == pytest.approx(
        plain.recon_percent / plain.recon_of_motion_percent
    )
    assert own.epe_percent / own.epe_of_flow_percent == pytest.approx(plain.epe_percent / plain.epe_of_flow_percent)


def without_part(data: IngestedSequence, part: int) -> IngestedSequence:
    """The same with a part that no frame shows."""
    kept = data.truth.labels != part
    counts = np.array([np.count_nonzero(of) for of in data.sequence.by_frame(kept)])
    sequence = data.sequence.replace(points=data.sequence.points[kept], point_counts=counts)
    return IngestedSequence(sequence=sequence, truth=data.truth.replace(labels=data.truth.labels[kept]))


def test_a_part_that_is_never_seen_is_not_missed() -> None:
    data = without_part(ingested(), 3)
    whole = true_model(ingested())
    model = whole.replace(
        labels=data.true_labels(CANONICAL),
        Ts_frame_canonical=whole.Ts_frame_canonical[:, :3],
        **{name: getattr(whole, name)[:2] for name in ("joint_parent", "joint_child", "joint_types", "axis", "point")},
        states=whole.states[:, :2],
        e_spatial=np.zeros(2),
        e_1dof=np.zeros(2),
    )
    metrics = measured(model, data)
    assert (metrics.parts_true, metrics.unseen_parts, metrics.tree_edit_distance) == (3, ("drawer",), 0)
    assert [joint.name for joint in metrics.joints] == ["joint 0", "joint 1"]
    assert figures_of(metrics, {}).moving_joints_found == 1
    assert measured(whole, ingested()).unseen_parts == ()


def test_a_link_that_is_never_seen_may_be_found_or_not() -> None:
    data = without_part(ingested(), 1)
    whole = true_model(ingested())
    with_link = whole.replace(labels=data.true_labels(CANONICAL))
    number = np.array([0, -1, 1, 2])
    without = whole.replace(
        labels=number[data.true_labels(CANONICAL)],
        Ts_frame_canonical=whole.Ts_frame_canonical[:, [0, 2, 3]],
        joint_parent=np.array([0, 0]),
        joint_child=np.array([1, 2]),
        joint_types=("revolute", "prismatic"),
        axis=whole.axis[1:],
        point=whole.point[1:],
        states=whole.states[:, 1:],
        e_spatial=np.zeros(2),
        e_1dof=np.zeros(2),
    )
    for model in (with_link, without):
        metrics = measured(model, data)
        assert (metrics.parts_true, metrics.tree_edit_distance) == (3, 0)
        assert [joint.name for joint in metrics.joints] == ["joint 2"]


def ball_model(data: IngestedSequence, aside: float) -> KinematicModel:
    """The true model with a ball joint for the second hinge, its centre `aside` (normalised)."""
    model = true_model(data)
    point = model.point.copy()
    point[1] = moved(data.truth.Ts_frame_first[CANONICAL], np.array([2]), POINT[1:2])[0] + [0, aside, 0]
    types = (TYPES[0], "spherical", TYPES[2])
    states = np.zeros((model.states.shape[0], 5))
    return model.replace(joint_types=types, point=point, states=states)


def ball_truth(data: IngestedSequence) -> IngestedSequence:
    first, second, third = data.truth.joints
    return with_truth(data, joints=(first, second.model_copy(update={"type": "spherical"}), third))


def test_the_centre_of_a_ball_joint_is_measured_in_the_canonical_frame_and_only_against_a_ball_joint() -> None:
    data = ingested()
    truth, labels_true = ball_truth(data).truth, data.true_labels(CANONICAL)
    joints = joint_errors(ball_model(data, 0.02), truth, labels_true)
    assert [joint.ball_centre_percent for joint in joints] == [None, pytest.approx(2.0), None]
    hinge = joint_errors(true_model(data), truth, labels_true)[1]
    assert (hinge.predicted_type, hinge.ball_centre_percent) == ("revolute", None)
    metrics = measured(true_model(data), data).replace(joints=(*joints, hinge))
    assert figures_of(metrics, {}).ball_centre_percent == pytest.approx(2.0)


def test_places_are_measured_at_the_joints_points_and_spreads_go_beside_the_errors() -> None:
    data = ingested()
    model = true_model(data)
    aside = np.cross(model.axis[0], [0.6, 0.0, 0.8])
    moved = model.point + np.array([0.02 * aside / np.linalg.norm(aside), np.zeros(3), np.zeros(3)])
    evidence = Evidence(excess=np.ones(FRAMES), unexplained=np.zeros(FRAMES), firmness=np.ones(4), open_share=0.0)
    spreads = (Spread(direction=0.1, place=0.03), Spread(direction=0.2, place=0.04), Spread(direction=0.3))
    assessment = Assessment(spreads=spreads, evidence=evidence, verdict=Verdict(trust="poor", reasons=()))
    config, rng = EvaluationConfig(), np.random.default_rng(0)
    metrics = compute_evaluation(model.replace(point=moved), data, config, rng, assessment)
    assert metrics.trust == "poor"
    first, second, third = metrics.joints
    assert (first.place_percent, second.place_percent) == (pytest.approx(2.0), pytest.approx(0.0, abs=1e-6))
    assert third.place_percent is None  # it slides
    assert [joint.place_spread_percent for joint in metrics.joints] == [pytest.approx(3.0), pytest.approx(4.0), None]
    assert first.direction_spread_deg == pytest.approx(np.degrees(0.1))
    assert measured(model, data).joints[0].direction_spread_deg is None


def rigid_surface(data: IngestedSequence) -> TrueSurface:
    """The observed points of all frames, each a vertex, moved with their parts."""
    labels = data.truth.labels
    home = np.linalg.inv(data.truth.Ts_frame_first)
    of_frames = zip(home, labels.reshape(FRAMES, -1), data.sequence.frames(), strict=True)
    first = np.concatenate([moved(T, of, p) for T, of, p in of_frames])
    return TrueSurface(
        vertices=np.stack([moved(Ts, labels, first) for Ts in data.truth.Ts_frame_first]),
        corners=np.tile(np.arange(len(first))[:, None], (1, 3)),
        weights=np.tile([0.5, 0.3, 0.2], (len(first), 1)),
    )


def test_a_surface_that_moves_as_the_parts_do_gives_their_errors() -> None:
    data = ingested()
    model = true_model(data)
    model = model.replace(Ts_frame_canonical=model.Ts_frame_canonical @ shifted(0.01))
    by_parts, by_surface = measured(model, data), measured(model, data.replace(surface=rigid_surface(data)))
    for name in ("recon", "recon_percent", "recon_of_motion_percent", "epe", "epe_of_flow_percent", "acc5", "acc10"):
        assert getattr(by_surface, name) == pytest.approx(getattr(by_parts, name), rel=1e-9), name
    assert by_surface.recon_percent == pytest.approx(1.0)
    assert by_surface.ari == by_parts.ari == 1


def shifted(by: float) -> np.ndarray:
    T = np.eye(4)
    T[0, 3] = by
    return T


def test_a_surface_alone_tells_the_errors_of_the_motion_in_percent_of_the_motion() -> None:
    data = ingested()
    surface = rigid_surface(data)
    rise = np.arange(FRAMES)[:, None, None] * np.array([0, 0, 0.03])
    soft = surface.vertices[:1] + rise * (1 + surface.vertices[:1, :, :1])  # by another way at each point
    alone = IngestedSequence(sequence=data.sequence, surface=surface.replace(vertices=soft))
    still = true_model(data).replace(Ts_frame_canonical=np.tile(np.eye(4), (FRAMES, 4, 1, 1)))
    metrics = measured(still, alone)
    assert metrics.recon_of_motion_percent == metrics.epe_of_flow_percent == pytest.approx(100)
    assert metrics.epe_percent == pytest.approx(3.0, rel=0.1)
    assert metrics.recon_percent == pytest.approx(3.0 * np.abs(np.arange(FRAMES) - CANONICAL).mean(), rel=0.1)
    assert (metrics.ari, metrics.parts_true, metrics.tree_edit_distance, metrics.joints) == (None, None, None, ())
    held = measured(still, alone.replace(surface=surface.replace(vertices=np.repeat(soft[:1], FRAMES, axis=0))))
    assert held.recon == pytest.approx(0, abs=1e-12)
    assert (held.recon_of_motion_percent, held.epe_of_flow_percent) == (None, None)


def test_a_surface_of_other_points_is_refused() -> None:
    data = ingested()
    surface = rigid_surface(data)
    with pytest.raises(ValueError, match="found places of 1199 points in 5 frames, expected 1200 in 5"):
        data.replace(surface=surface.replace(corners=surface.corners[1:], weights=surface.weights[1:]))


def test_without_ground_truth_only_the_chamfer_distance_is_known() -> None:
    data = ingested()
    metrics = measured(true_model(data), data.replace(truth=None))
    known = {name for name, value in metrics.model_dump().items() if value not in (None, ())}
    assert known == {"units", "diagonal", "canonical_frame", "parts_found", "chamfer_percent"}
    assert metrics.chamfer_percent == measured(true_model(data), data).chamfer_percent


def test_an_unknown_tree_and_no_unseen_states_leave_their_metrics_out() -> None:
    data = with_truth(ingested(), parent=np.full(4, -1), Ts_novel_first=np.zeros((0, 4, 4, 4)), joints=())
    metrics = measured(true_model(data), data)
    assert metrics.tree_edit_distance is None
    assert metrics.reanimation is None
    assert metrics.joint_type_accuracy is None
    assert metrics.recon == pytest.approx(0, abs=1e-12)


def test_chamfer_distance_equals_its_naive_twin() -> None:
    rng = np.random.default_rng(0)
    predicted, frames = rng.normal(size=(3, 50, 3)), [rng.normal(size=(n, 3)) for n in (40, 50, 60)]
    naive = [
        (cdist(p, q).min(axis=1).mean() + cdist(p, q).min(axis=0).mean()) / 2
        for p, q in zip(predicted, frames, strict=True)
    ]
    assert chamfer_distance(predicted, frames) == pytest.approx(np.mean(naive))


@pytest.mark.parametrize(
    ("axis", "point", "distance"),
    [([0, 1, 0], [2, 5, 1], 2.0), ([0, 0, 1], [3, 4, 9], 5.0), ([0, 0.6, 0.8], [0, 0, 7], 0.0)],
    ids=["skew", "parallel", "crossing"],
)
def test_distance_of_a_line_to_the_z_axis(axis: list[float], point: list[float], distance: float) -> None:
    found = line_distance(np.array([0.0, 0, 1]), np.array([0.0, 0, 3]), np.array(axis), np.array(point))
    assert found == pytest.approx(distance)
