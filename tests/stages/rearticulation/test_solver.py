from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.joints import REVOLUTE, SPHERICAL
from schemas.kinematic import KinematicModel
from stages.final_fit.working import chain_of
from stages.kernels.kinematics.chain import Chain, Joint
from stages.rearticulation.mechanism import Mechanism
from stages.rearticulation.solver import condensed, rearticulate

FRAMES, CANONICAL = 6, 2


def random_model(rng: np.random.Generator, joint_types: list[str], observed: float = 0.5) -> KinematicModel:
    """A random tree whose parts are about 0.1 apart; joint j moves part j + 1."""
    joints = len(joint_types)
    parent = np.array([max(0, j - int(rng.integers(3))) for j in range(joints)], dtype=np.int64)
    centre = np.zeros((joints + 1, 3))
    for j in range(joints):
        step = rng.normal(size=3)
        centre[j + 1] = centre[parent[j]] + 0.1 * step / np.linalg.norm(step)
    axis = rng.normal(size=(joints, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    point = (centre[1:] + centre[parent]) / 2
    states = np.zeros((joints, FRAMES, 2))
    for j, kind in enumerate(joint_types):
        if kind != "prismatic":
            states[j, :, 0] = rng.uniform(-observed, observed, FRAMES)
        if kind != "revolute":
            states[j, :, 1] = rng.uniform(-0.05, 0.05, FRAMES)
    states[:, CANONICAL] = 0
    columns = [states[j][:, free_columns(kind)] for j, kind in enumerate(joint_types)]
    model = KinematicModel(
        canonical_frame=CANONICAL,
        root=0,
        labels=np.arange(joints + 1),
        Ts_frame_canonical=np.tile(np.eye(4), (FRAMES, joints + 1, 1, 1)),
        joint_parent=parent,
        joint_child=np.arange(1, joints + 1),
        joint_types=tuple(joint_types),
        axis=axis,
        point=point - axis * (point * axis).sum(1, keepdims=True),
        states=np.concatenate([np.zeros((FRAMES, 0)), *columns], axis=1),
        e_spatial=np.zeros(joints),
        e_1dof=np.zeros(joints),
        energies={},
    )
    return model.replace(Ts_frame_canonical=np.stack([pose(model, states[:, t]) for t in range(FRAMES)]))


def pose(model: KinematicModel, states: np.ndarray, T_pose_root: np.ndarray | None = None) -> np.ndarray:
    """Forward kinematics, written anew: a point turns about the axis, slides along it, then follows the parent."""
    Ts = [np.eye(4) if T_pose_root is None else T_pose_root]
    for j, (angle, distance) in enumerate(states):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_rotvec(angle * model.axis[j]).as_matrix()
        T[:3, 3] = model.point[j] - T[:3, :3] @ model.point[j] + distance * model.axis[j]
        Ts.append(Ts[model.joint_parent[j]] @ T)
    return np.stack(Ts)


def solve(
    model: KinematicModel, p_source: np.ndarray, parts: np.ndarray, p_target: np.ndarray, free_root: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """States (joints, 2) and poses (parts, 4, 4)."""
    mechanism = Mechanism.without_limits(chain_of(model, free_root))
    found = rearticulate(mechanism, p_source, parts, p_target)
    return turns_and_slides(model, found.coordinates), found.Ts_pose_canonical


def free_columns(kind: str) -> list[int]:
    """Which of (angle, distance) a joint of each type can change."""
    return {"revolute": [0], "prismatic": [1], "screw": [0, 1]}[kind]


def turns_and_slides(model: KinematicModel, coordinates: np.ndarray) -> np.ndarray:
    """The angle and the distance of every joint (joints, 2)."""
    states, first = np.zeros((len(model.joint_types), 2)), 0
    for j, kind in enumerate(model.joint_types):
        free = free_columns(kind)
        states[j, free] = coordinates[first : first + len(free)]
        first += len(free)
    return states


def moved(Ts: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", Ts[:, :3, :3], p) + Ts[:, :3, 3]


def point_of_each_part(rng: np.random.Generator, model: KinematicModel) -> np.ndarray:
    """About 0.07 from the part's own joint."""
    near = np.concatenate([np.zeros((1, 3)), model.point + rng.normal(size=model.point.shape) * 0.04])
    along = np.concatenate([np.zeros((1, 3)), model.axis * rng.normal(size=(len(model.axis), 1)) * 0.02])
    return near + along


@pytest.mark.parametrize("seed", range(5))
def test_one_point_a_part_gives_back_the_pose_far_outside_the_observed_range(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_model(rng, ["revolute", "prismatic", "revolute", "screw", "revolute", "revolute"])
    true = np.zeros((6, 2))
    true[[0, 2, 3, 4, 5], 0] = rng.uniform(-np.pi / 2, np.pi / 2, 5)
    true[[1, 3], 1] = rng.uniform(-0.1, 0.1, 2)
    p_source = point_of_each_part(rng, model)
    states, Ts = solve(model, p_source, np.arange(7), moved(pose(model, true), p_source))
    np.testing.assert_allclose(states, true, atol=1e-5)
    np.testing.assert_allclose(Ts, pose(model, true), atol=1e-5)


def test_a_half_turn_of_a_joint_that_was_still_is_found_and_turns_no_other_joint() -> None:
    model = random_model(np.random.default_rng(0), ["revolute", "revolute"], observed=0.0)
    true = np.array([[np.pi, 0.0], [0.0, 0.0]])
    p_source = point_of_each_part(np.random.default_rng(1), model)[:2]
    states, Ts = solve(model, p_source, np.arange(2), moved(pose(model, true)[:2], p_source))
    np.testing.assert_allclose(Ts, pose(model, true), atol=1e-3)
    assert states[1, 0] == pytest.approx(0, abs=1e-6)


def test_the_returned_poses_follow_from_the_states_and_types_stay_exact() -> None:
    rng = np.random.default_rng(7)
    model = random_model(rng, ["revolute", "prismatic", "revolute", "prismatic"])
    p_source = point_of_each_part(rng, model)
    states, Ts = solve(model, p_source, np.arange(5), p_source + rng.normal(size=p_source.shape) * 0.05)
    np.testing.assert_allclose(Ts, pose(model, states), atol=1e-12)
    assert (states[[0, 2], 1] == 0).all()
    assert (states[[1, 3], 0] == 0).all()


def test_no_small_change_of_a_state_comes_closer_to_unreachable_targets() -> None:
    rng = np.random.default_rng(3)
    model = random_model(rng, ["revolute", "revolute", "screw", "prismatic"])
    parts = np.repeat(np.arange(5), 4)
    p_source = np.repeat(point_of_each_part(rng, model), 4, axis=0) + rng.normal(size=(20, 3)) * 0.05
    p_target = p_source + rng.normal(size=(20, 3)) * 0.03

    def cost(states: np.ndarray) -> float:
        return float(((moved(pose(model, states)[parts], p_source) - p_target) ** 2).sum())

    states, _ = solve(model, p_source, parts, p_target)
    for joint, column in [(0, 0), (1, 0), (2, 0), (2, 1), (3, 1)]:
        for change in (-1e-3, 1e-3):
            nudged = states.copy()
            nudged[joint, column] += change
            assert cost(nudged) > cost(states)


def test_a_joint_without_targets_stays_as_in_the_nearest_observed_frame() -> None:
    rng = np.random.default_rng(4)
    model = random_model(rng, ["revolute", "revolute", "revolute"])
    model = model.replace(joint_parent=np.array([0, 0, 0]))
    p_source = point_of_each_part(rng, model)[1:3]
    p_target = moved(pose(model, turns_and_slides(model, model.states[4]))[1:3], p_source)
    states, _ = solve(model, p_source, np.array([1, 2]), p_target)
    np.testing.assert_allclose(states, turns_and_slides(model, model.states[4]), atol=1e-6)


def test_without_any_target_the_canonical_pose_remains() -> None:
    model = random_model(np.random.default_rng(5), ["revolute", "prismatic"])
    states, Ts = solve(model, np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    assert (states == 0).all()
    np.testing.assert_array_equal(Ts, np.tile(np.eye(4), (3, 1, 1)))


@pytest.mark.parametrize("free_root", [True, False])
def test_the_root_moves_only_where_it_is_free(free_root: bool) -> None:
    rng = np.random.default_rng(6)
    model = random_model(rng, ["revolute"] * 4)
    T_pose_root = np.eye(4)
    T_pose_root[:3, :3] = Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix()
    T_pose_root[:3, 3] = [0.2, -0.1, 0.3]
    true = np.stack([rng.uniform(-1, 1, 4), np.zeros(4)], axis=1)
    p_source = point_of_each_part(rng, model)
    p_target = moved(pose(model, true, T_pose_root), p_source)
    states, Ts = solve(model, p_source, np.arange(5), p_target, free_root=free_root)
    if free_root:
        np.testing.assert_allclose(states, true, atol=1e-5)
        np.testing.assert_allclose(Ts[0], T_pose_root, atol=1e-5)
    else:
        np.testing.assert_array_equal(Ts[0], np.eye(4))


def test_a_free_root_that_the_targets_leave_open_stays_as_in_the_nearest_observed_frame() -> None:
    rng = np.random.default_rng(9)
    model = random_model(rng, ["revolute"])
    T_frame_root = np.tile(np.eye(4), (FRAMES, 1, 1))
    turns = np.arange(FRAMES)[:, None] - CANONICAL
    T_frame_root[:, :3, :3] = Rotation.from_rotvec(turns * [0.1, 0.2, 0]).as_matrix()
    T_frame_root[:, :3, 3] = turns * [0.1, 0, 0.05]
    model = model.replace(Ts_frame_canonical=T_frame_root[:, None] @ model.Ts_frame_canonical)
    p_source = point_of_each_part(rng, model)[1:]
    p_target = moved(model.Ts_frame_canonical[4, 1:], p_source)
    _, Ts = solve(model, p_source, np.array([1]), p_target, free_root=True)
    np.testing.assert_allclose(Ts, model.Ts_frame_canonical[4], atol=1e-6)


def test_a_single_part_has_no_states() -> None:
    model = random_model(np.random.default_rng(8), [])
    states, Ts = solve(model, np.ones((1, 3)), np.array([0]), np.zeros((1, 3)))
    assert states.shape == (0, 2)
    np.testing.assert_array_equal(Ts, np.eye(4)[None])


def dense(rng: np.random.Generator, model: KinematicModel, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Source points and their parts, many a part."""
    parts = np.repeat(np.arange(model.part_count), points)
    near = np.repeat(point_of_each_part(rng, model), points, axis=0)
    return near + rng.normal(size=near.shape) * 0.05, parts


@pytest.mark.parametrize("free_root", [False, True])
def test_dense_targets_give_back_any_states(free_root: bool) -> None:
    rng = np.random.default_rng(12)
    model = random_model(rng, ["revolute", "prismatic", "screw", "revolute", "revolute"] * 2)
    turns = np.array([kind != "prismatic" for kind in model.joint_types])
    slides = np.array([kind != "revolute" for kind in model.joint_types])
    true = np.stack([rng.uniform(-3, 3, 10) * turns, rng.uniform(-0.1, 0.1, 10) * slides], axis=1)
    T_pose_root = np.eye(4)
    if free_root:
        T_pose_root[:3, :3] = Rotation.random(random_state=1).as_matrix()
        T_pose_root[:3, 3] = [0.5, -0.2, 0.1]
    p_source, parts = dense(rng, model, 50)
    p_target = moved(pose(model, true, T_pose_root)[parts], p_source)
    states, Ts = solve(model, p_source, parts, p_target, free_root)
    np.testing.assert_allclose(states, true, atol=1e-6)
    np.testing.assert_allclose(Ts, pose(model, true, T_pose_root), atol=1e-6)


def test_condensed_targets_cost_what_all_do_under_any_motion() -> None:
    rng = np.random.default_rng(13)
    parts = rng.permutation(np.repeat([0, 1, 3], [5, 200, 40]))
    p_source, p_target = rng.normal(size=(2, len(parts), 3))
    p_target = p_source + 1e-3 * p_target
    p, rows, q = condensed(p_source, parts, p_target)
    assert np.bincount(rows).tolist() == [5, 7, 0, 7]
    for spread in (1e-3, 1.0):
        Ts = np.tile(np.eye(4), (4, 1, 1))
        Ts[:, :3, :3] = Rotation.from_rotvec(spread * rng.normal(size=(4, 3))).as_matrix()
        Ts[:, :3, 3] = spread * rng.normal(size=(4, 3))
        direct = ((moved(Ts[parts], p_source) - p_target) ** 2).sum()
        short = ((np.einsum("nij,nj->ni", Ts[rows, :3], p) - q) ** 2).sum()
        assert short == pytest.approx(direct, rel=1e-10)


def test_the_pose_of_condensed_targets_is_that_of_all() -> None:
    rng = np.random.default_rng(14)
    model = random_model(rng, ["revolute", "revolute", "prismatic"])
    p_source, parts = dense(rng, model, 7)
    p_target = p_source + rng.normal(size=p_source.shape) * 0.03
    few, _ = solve(model, p_source, parts, p_target)  # seven a part stay as they are
    many, _ = solve(model, *(np.repeat(rows, 5, axis=0) for rows in (p_source, parts, p_target)))
    np.testing.assert_allclose(many, few, atol=1e-6)


def test_limits_are_kept_and_the_joints_at_them_are_told() -> None:
    rng = np.random.default_rng(15)
    model = random_model(rng, ["revolute", "revolute", "prismatic", "revolute"])
    true = np.array([[0.9, 0.0], [-0.2, 0.0], [0.0, -0.2], [0.1, 0.0]])
    bound = np.array([0.5, 0.5, 0.1, 0.5])
    mechanism = replace(Mechanism.without_limits(chain_of(model, False)), lower=-bound, upper=bound)
    p_source, parts = dense(rng, model, 20)
    p_target = moved(pose(model, true)[parts], p_source)
    found = rearticulate(mechanism, p_source, parts, p_target)
    assert (np.abs(found.coordinates) <= bound).all()
    assert found.coordinates[[0, 2]] == pytest.approx([0.5, -0.1])
    assert found.bounded.tolist() == [True, False, True, False]

    def cost(coordinates: np.ndarray) -> float:
        Ts = mechanism.tree.Ts_pose_canonical(coordinates[None])[0]
        return float(((moved(Ts[parts], p_source) - p_target) ** 2).sum())

    for c, change in [(0, -1e-3), (1, 1e-3), (1, -1e-3), (2, 1e-3), (3, 1e-3), (3, -1e-3)]:
        assert cost(found.coordinates + change * np.eye(4)[c]) > cost(found.coordinates)


def ball_chain(observed: np.ndarray) -> Mechanism:
    """Part 1 hangs on part 0 by a ball at (0.2, 0, 0), part 2 on it by a hinge about y at (0.4, 0, 0)."""
    joints = [
        Joint(SPHERICAL, 0, 1, np.array([0.0, 0.0, 1.0]), np.array([0.2, 0.0, 0.0]), observed),
        Joint(REVOLUTE, 1, 2, np.array([0.0, 1.0, 0.0]), np.array([0.4, 0.0, 0.0]), np.zeros((len(observed), 1))),
    ]
    T_frame_root = np.tile(np.eye(4), (len(observed), 1, 1))
    return Mechanism.without_limits(Chain.of(joints, 0, T_frame_root, free_root=False))


@pytest.mark.parametrize("angle", [0.3, 1.5, 2.8, np.pi])
def test_a_ball_joint_turns_about_any_axis(angle: float) -> None:
    mechanism = ball_chain(np.zeros((2, 3)))
    p_source = np.array([[0.3, 0, 0], [0.3, 0.1, 0], [0.3, 0, 0.1], [0.5, 0.1, 0], [0.6, 0, 0.1]])
    parts = np.array([1, 1, 1, 2, 2])
    true = np.append(angle * np.array([0.48, -0.64, 0.6]), 0.7)
    Ts = mechanism.tree.Ts_pose_canonical(true[None])[0]
    found = rearticulate(mechanism, p_source, parts, moved(Ts[parts], p_source))
    np.testing.assert_allclose(found.Ts_pose_canonical, Ts, atol=1e-6)
    assert found.coordinates[3] == pytest.approx(0.7)
    assert not found.undetermined.any()


def test_a_ball_joint_turns_no_farther_than_its_limit() -> None:
    mechanism = replace(
        ball_chain(np.zeros((2, 3))), upper=np.array([0.5, 0.5, 0.5, 9]), lower=-np.array([0.5] * 3 + [9])
    )
    p_source = np.array([[0.3, 0, 0], [0.3, 0.1, 0], [0.3, 0, 0.1]])
    parts = np.ones(3, dtype=np.int64)
    Ts = mechanism.tree.Ts_pose_canonical(np.array([[0.0, 0.6, 0.8, 0.0]]))[0]
    found = rearticulate(mechanism, p_source, parts, moved(Ts[parts], p_source))
    turn = found.coordinates[:3]
    assert np.linalg.norm(turn) == pytest.approx(0.5)
    assert found.bounded[:3].any()
    assert not found.bounded[3]

    def cost(turn: np.ndarray) -> float:
        T = mechanism.tree.Ts_pose_canonical(np.append(turn, 0.0)[None])[0, 1]
        return float(((moved(T[None], p_source) - moved(Ts[parts], p_source)) ** 2).sum())

    for aside in np.eye(3)[:2] * 1e-3:
        nudged = turn + aside - (aside @ turn) * turn / 0.25
        assert cost(nudged * 0.5 / np.linalg.norm(nudged)) > cost(turn)


def test_what_the_targets_do_not_tell_is_told_and_stays_at_the_nearest_observed_frame() -> None:
    observed = np.array([[0.0, 0.0, 0.0], [0.4, 0.2, -0.3]])
    mechanism = ball_chain(observed)
    Ts = mechanism.tree.Ts_pose_canonical(np.append(observed[1], 0.0)[None])[0]
    p_source = np.array([[0.3, 0.0, 0.0]])  # one point of the ball's part: a turn about the line to it is not told
    found = rearticulate(mechanism, p_source, np.array([1]), moved(Ts[1:2], p_source))
    np.testing.assert_allclose(found.coordinates, [0.4, 0.2, -0.3, 0.0], atol=1e-6)
    assert found.undetermined[3] == 1
    assert found.undetermined[:3].sum() == pytest.approx(1, abs=1e-3)


def test_a_chain_of_hinges_with_one_target_at_its_end_reaches_it_though_no_hinge_is_told() -> None:
    joints = 5
    axis, step = np.array([0.0, 0.0, 1.0]), np.array([0.15, 0.02, 0.0])
    hinges = [Joint(REVOLUTE, j, j + 1, axis, (j + 1) * step, np.zeros((1, 1))) for j in range(joints)]
    mechanism = Mechanism.without_limits(Chain.of(hinges, 0, np.eye(4)[None], free_root=False))
    p_target = np.array([[0.5, 0.5, 0.0]])
    found = rearticulate(mechanism, np.array([[0.9, 0.0, 0.0]]), np.array([joints]), p_target)
    reached = moved(found.Ts_pose_canonical[[joints]], np.array([[0.9, 0.0, 0.0]]))
    np.testing.assert_allclose(reached, p_target, atol=1e-4)
    assert (found.undetermined > 0.05).all()


def test_noise_does_not_turn_a_joint_whose_targets_lie_next_to_its_axis() -> None:
    rng = np.random.default_rng(16)
    model = random_model(rng, ["revolute", "revolute"])
    p_source, parts = dense(rng, model, 20)
    on_axis = model.point[1] + np.linspace(-0.1, 0.1, 20)[:, None] * model.axis[1]
    p_source[parts == 2] = on_axis + rng.normal(size=(20, 3)) * 1e-4
    p_target = p_source + rng.normal(size=p_source.shape) * 5e-3
    mechanism = Mechanism.without_limits(chain_of(model, False))
    found = rearticulate(mechanism, p_source, parts, p_target)
    start = np.abs(mechanism.chain.states[:, 1] - found.coordinates[1]).min()
    assert (found.undetermined > 0.05).tolist()[0] is False
    assert found.undetermined[1] > 0.9
    assert min(start, abs(found.coordinates[1])) < 0.01
