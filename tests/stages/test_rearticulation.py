from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.kinematic import KinematicModel
from stages.rearticulation import rearticulate

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
        states=states,
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
    states, Ts = rearticulate(model, p_source, np.arange(7), moved(pose(model, true), p_source))
    np.testing.assert_allclose(states, true, atol=5e-3)
    np.testing.assert_allclose(Ts, pose(model, true), atol=5e-3)


def test_a_half_turn_of_a_joint_that_was_still_is_found_and_turns_no_other_joint() -> None:
    model = random_model(np.random.default_rng(0), ["revolute", "revolute"], observed=0.0)
    true = np.array([[np.pi, 0.0], [0.0, 0.0]])
    p_source = point_of_each_part(np.random.default_rng(1), model)[:2]
    states, Ts = rearticulate(model, p_source, np.arange(2), moved(pose(model, true)[:2], p_source))
    np.testing.assert_allclose(Ts, pose(model, true), atol=1e-3)
    assert states[1, 0] == pytest.approx(0, abs=1e-6)


def test_the_returned_poses_follow_from_the_states_and_types_stay_exact() -> None:
    rng = np.random.default_rng(7)
    model = random_model(rng, ["revolute", "prismatic", "revolute", "prismatic"])
    p_source = point_of_each_part(rng, model)
    states, Ts = rearticulate(model, p_source, np.arange(5), p_source + rng.normal(size=p_source.shape) * 0.05)
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

    states, _ = rearticulate(model, p_source, parts, p_target)
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
    p_target = moved(pose(model, model.states[:, 4])[1:3], p_source)
    states, _ = rearticulate(model, p_source, np.array([1, 2]), p_target)
    np.testing.assert_allclose(states, model.states[:, 4], atol=1e-6)


def test_without_any_target_the_canonical_pose_remains() -> None:
    model = random_model(np.random.default_rng(5), ["revolute", "prismatic"])
    states, Ts = rearticulate(model, np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
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
    states, Ts = rearticulate(model, p_source, np.arange(5), p_target, free_root=free_root)
    if free_root:
        np.testing.assert_allclose(states, true, atol=5e-3)
        np.testing.assert_allclose(Ts[0], T_pose_root, atol=5e-3)
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
    _, Ts = rearticulate(model, p_source, np.array([1]), p_target, free_root=True)
    np.testing.assert_allclose(Ts, model.Ts_frame_canonical[4], atol=1e-6)


def test_a_single_part_has_no_states() -> None:
    model = random_model(np.random.default_rng(8), [])
    states, Ts = rearticulate(model, np.ones((1, 3)), np.array([0]), np.zeros((1, 3)))
    assert states.shape == (0, 2)
    np.testing.assert_array_equal(Ts, np.eye(4)[None])
