import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from stages.kernels.kinematics.forward_kinematics import forward_kinematics
from stages.kernels.kinematics.kinematic_tree import WORLD, KinematicTree, rotations

RNG = np.random.default_rng(0)
AXIS = np.array([0.6, 0.0, 0.8])
POINT = RNG.normal(size=(5, 3))


def tree():
    """A free root 2, a hinge 2-0, a slide and turn 0-3, a ball 3-1, a slider 2-4: no joint in order."""
    bases = {
        0: np.kron(np.eye(2), AXIS),
        1: np.eye(3, 6),
        2: np.kron([1, 0], AXIS)[None],
        3: np.kron([0, 1], AXIS)[None],
    }
    bases[4] = np.eye(6)
    return KinematicTree(
        parts=5,
        parent=np.array([0, 3, 2, 2, WORLD]),
        child=np.array([3, 1, 0, 4, 2]),
        point=POINT,
        joint=np.repeat(np.arange(5), [len(bases[joint]) for joint in range(5)]),
        basis=np.concatenate([bases[joint] for joint in range(5)]),
    )


def test_joints_come_after_their_parents_own_and_move_all_that_hangs_on_them():
    found = tree()
    seen = {WORLD}
    for joint in found.order:
        assert found.parent[joint] in seen
        seen.add(found.child[joint])
    assert [set(np.flatnonzero(row)) for row in found.moves] == [{1, 3}, {1}, {0, 1, 3}, {4}, {0, 1, 2, 3, 4}]


def test_parts_lie_where_the_screw_joints_of_the_fit_put_them():
    links = [(0, 1), (1, 2), (0, 3)]
    axis = RNG.normal(size=(3, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    point, states = RNG.normal(size=(3, 3)), RNG.normal(size=(3, 4, 2))
    expected = forward_kinematics(
        torch.eye(4, dtype=torch.float64).expand(4, 4, 4),
        links,
        torch.from_numpy(axis),
        torch.from_numpy(point),
        torch.from_numpy(states),
        root=0,
    )
    screws = KinematicTree(
        parts=4,
        parent=np.array([parent for parent, _ in links]),
        child=np.array([child for _, child in links]),
        point=point,
        joint=np.repeat(np.arange(3), 2),
        basis=np.concatenate([np.kron(np.eye(2), direction) for direction in axis]),
    )
    found = screws.Ts_pose_canonical(states.transpose(1, 0, 2).reshape(4, 6))
    np.testing.assert_allclose(found, expected.numpy(), atol=1e-12)


def test_a_twist_says_how_a_posed_point_moves_with_its_coordinate():
    found = tree()
    coordinates = RNG.normal(size=(2, 13))
    Ts = found.Ts_pose_canonical(coordinates)
    twists = found.twists(coordinates, Ts)
    p = np.append(RNG.normal(size=3), 1.0)
    for c in range(13):
        step = np.zeros(13)
        step[c] = 1e-6
        ahead, behind = (found.Ts_pose_canonical(coordinates + sign * step) @ p for sign in (1, -1))
        speed = ((ahead - behind) / 2e-6)[..., :3]
        x = (Ts @ p)[..., :3]
        predicted = np.cross(twists[:, c, None, :3], x) + twists[:, c, None, 3:]
        np.testing.assert_allclose(speed, predicted * found.moves[found.joint[c]][:, None], atol=1e-8)


@pytest.mark.parametrize("length", [0.0, 1e-9, 5e-3, 0.02, 1.0, np.pi, 6.0])
def test_rotations_and_their_left_jacobians(length):
    turn = length * AXIS
    R, J = rotations(turn)
    np.testing.assert_allclose(R, Rotation.from_rotvec(turn).as_matrix(), atol=1e-15)
    for column in range(3):
        step = np.zeros(3)
        step[column] = 1e-6
        change = Rotation.from_rotvec(turn + step) * Rotation.from_rotvec(turn - step).inv()
        np.testing.assert_allclose(change.as_rotvec() / 2e-6, J[:, column], atol=1e-8)
