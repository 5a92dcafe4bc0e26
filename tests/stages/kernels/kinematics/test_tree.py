import mujoco
import numpy as np
import pytest
import pytransform3d.transformations as oracle
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from schemas.joints import PRISMATIC, REVOLUTE, SCREW, SPHERICAL
from stages.kernels.kinematics.tree import WORLD, KinematicTree, joint_transforms
from stages.kernels.motion.rigid_motion import rotations

RNG = np.random.default_rng(0)
AXIS = np.array([0.6, 0.0, 0.8])
POINT = RNG.normal(size=(4, 3))
unit = st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)
points = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)


def tree(free_root=True):
    """A root 2, a hinge 2-0, a slide and turn 0-3, a ball 3-1, a slider 2-4: no joint in order."""
    return KinematicTree(
        kinds=(SCREW, SPHERICAL, REVOLUTE, PRISMATIC),
        parent=np.array([0, 3, 2, 2]),
        child=np.array([3, 1, 0, 4]),
        axis=np.tile(AXIS, (4, 1)),
        point=POINT,
        root=2,
        free_root=free_root,
    )


def test_joints_come_after_their_parents_own_and_move_all_that_hangs_on_them():
    found = tree()
    seen = {found.root}
    for joint in found.order:
        assert found.parent[joint] in seen
        seen.add(found.child[joint])
    assert [set(np.flatnonzero(row)) for row in found.moves] == [{1, 3}, {1}, {0, 1, 3}, {4}]
    assert found.parents.tolist() == [2, 3, WORLD, 0, 2]


def test_coordinates_are_the_joints_states_one_after_the_other_and_then_a_free_roots():
    found = tree()
    assert (found.parts, found.size, tree(free_root=False).size) == (5, 13, 7)
    assert found.joint.tolist() == [0, 0, 1, 1, 1, 2, 3, *[4] * 6]
    assert [found.coordinates_of(joint) for joint in range(5)] == [
        slice(0, 2), slice(2, 5), slice(5, 6), slice(6, 7), slice(7, 13),
    ]  # fmt: skip
    assert found.balls.tolist() == [[2, 3, 4], [7, 8, 9]]
    assert found.angles.tolist() == [0, 5]
    assert found.units(0.5).tolist() == [1, 0.5, 1, 1, 1, 1, 0.5, 1, 1, 1, 0.5, 0.5, 0.5]
    moves = [*found.moves, np.ones(5, dtype=bool)]
    np.testing.assert_array_equal(found.moved_by, [moves[joint] for joint in found.joint])


def test_the_motion_of_each_joint_is_along_its_axis_or_any_way():
    coordinates = np.arange(1.0, 14.0)
    motions = tree().motions(coordinates[None])[0]
    expected = [
        [*(1 * AXIS), *(2 * AXIS)],
        [3, 4, 5, 0, 0, 0],
        [*(6 * AXIS), 0, 0, 0],
        [0, 0, 0, *(7 * AXIS)],
        [8, 9, 10, 11, 12, 13],
    ]
    np.testing.assert_allclose(motions, expected, atol=1e-12)


@pytest.mark.parametrize(
    "links",
    [
        [(0, 1), (2, 3), (3, 2)],
        [(0, 1), (1, 2), (3, 3)],
        [(0, 1), (0, 1), (1, 2)],
        [(1, 2), (2, 3), (3, 1)],
        [(0, 1), (1, 2), (-1, 3)],
    ],
)
def test_joints_that_do_not_hang_on_the_root_are_refused(links):
    parent, child = np.array(links).T
    with pytest.raises(ValueError, match="do not hang on the root 0"):
        KinematicTree((REVOLUTE,) * 3, parent, child, np.tile(AXIS, (3, 1)), np.zeros((3, 3)), root=0)


def test_one_part_has_no_joints_but_may_move():
    nothing = np.zeros(0, dtype=np.int64)
    still = KinematicTree((), nothing, nothing, np.zeros((0, 3)), np.zeros((0, 3)), root=0)
    np.testing.assert_array_equal(still.Ts_pose_canonical(np.zeros((3, 0))), np.tile(np.eye(4), (3, 1, 1, 1)))
    assert still.moves.shape == (0, 1)
    free = KinematicTree((), nothing, nothing, np.zeros((0, 3)), np.zeros((0, 3)), root=0, free_root=True)
    T = free.Ts_pose_canonical(np.array([[0.1, 0.2, 0.3, 4, 5, 6]]))[0, 0]
    np.testing.assert_allclose(T[:3, :3], Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(T[:3, 3], [4, 5, 6])


# A three-joint chain with a side branch and a ball, axes and anchors given in world coordinates at zero position.
MJCF = """
<mujoco>
  <worldbody>
    <body name="b0"><geom size="0.1"/>
      <body name="b1"><joint type="hinge" axis="0 0 1" pos="0.5 0 0"/><geom size="0.1"/>
        <body name="b2"><joint type="slide" axis="0.6 0.8 0" pos="0 0 0"/><geom size="0.1"/></body>
        <body name="b3"><joint type="hinge" axis="0 1 0" pos="1 0.2 0.3"/><geom size="0.1"/>
          <body name="b4"><joint type="ball" pos="0.4 -0.2 0.1"/><geom size="0.1"/></body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_agrees_with_mujoco():
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    ours = KinematicTree(
        kinds=(REVOLUTE, PRISMATIC, REVOLUTE, SPHERICAL),
        parent=np.array([0, 1, 1, 3]),
        child=np.array([1, 2, 3, 4]),
        axis=np.array([[0, 0, 1.0], [0.6, 0.8, 0], [0, 1.0, 0], [0, 0, 1.0]]),
        point=np.array([[0.5, 0, 0], [0, 0, 0], [1, 0.2, 0.3], [0.4, -0.2, 0.1]]),
        root=0,
    )
    states = np.random.default_rng(0).uniform(-1, 1, size=(6, 6))
    Ts = ours.Ts_pose_canonical(states)
    for frame in range(6):
        quaternion = Rotation.from_rotvec(states[frame, 3:]).as_quat(scalar_first=True)
        data.qpos[:] = [*states[frame, :3], *quaternion]
        mujoco.mj_kinematics(model, data)
        for part in range(5):
            body = model.body(f"b{part}").id
            np.testing.assert_allclose(Ts[frame, part, :3, :3], data.xmat[body].reshape(3, 3), atol=1e-9)
            np.testing.assert_allclose(Ts[frame, part, :3, 3], data.xpos[body], atol=1e-9)


def test_a_moving_root_carries_every_part():
    coordinates = RNG.normal(size=(2, 13))
    root = joint_transforms(np.zeros(3), coordinates[:, 7:])
    carried = root[:, None] @ tree(free_root=False).Ts_pose_canonical(coordinates[:, :7])
    np.testing.assert_allclose(tree().Ts_pose_canonical(coordinates), carried, atol=1e-12)
    shift = np.zeros((1, 13))
    shift[0, 10:] = [1.0, 2.0, 3.0]
    np.testing.assert_allclose(tree().Ts_pose_canonical(shift)[0, :, :3, 3], np.tile([1.0, 2.0, 3.0], (5, 1)))


@pytest.mark.parametrize("scale", [0.0, 1e-4, 1.0])
@pytest.mark.parametrize("free_root", [False, True])
@pytest.mark.parametrize("additive", [True, False])
def test_a_twist_says_how_a_posed_point_moves_with_its_coordinate(additive, free_root, scale):
    found = tree(free_root)
    coordinates = scale * RNG.normal(size=(2, found.size))
    Ts = found.Ts_pose_canonical(coordinates)
    twists = found.twists(coordinates, Ts, additive)
    p = np.append(RNG.normal(size=3), 1.0)
    for c in range(found.size):
        steps = 1e-6 * np.tile(np.eye(found.size)[c], (2, 1))
        ahead, behind = (
            coordinates + sign * steps if additive else found.stepped(coordinates, sign * steps) for sign in (1, -1)
        )
        speed = ((found.Ts_pose_canonical(ahead) - found.Ts_pose_canonical(behind)) @ p / 2e-6)[..., :3]
        x = (Ts @ p)[..., :3]
        predicted = np.cross(twists[:, c, None, :3], x) + twists[:, c, None, 3:]
        np.testing.assert_allclose(speed, predicted * found.moved_by[c][:, None], atol=1e-8)


def test_a_step_turns_rotation_vectors_on_from_outside_and_adds_to_all_else():
    found = tree()
    coordinates, step = RNG.normal(size=(2, 3, 13))
    after = found.stepped(coordinates, step)
    rest = np.setdiff1d(np.arange(13), found.balls)
    np.testing.assert_array_equal(after[:, rest], (coordinates + step)[:, rest])
    for ball in found.balls:
        expected = Rotation.from_rotvec(step[:, ball]) * Rotation.from_rotvec(coordinates[:, ball])
        np.testing.assert_allclose(rotations(after[:, ball]), expected.as_matrix(), atol=1e-12)
    assert not np.allclose(after[:, found.balls], (coordinates + step)[:, found.balls])
    np.testing.assert_allclose(found.stepped(coordinates * 0.5, 0 * step), coordinates * 0.5, atol=1e-12)


@given(unit, points, st.floats(-3, 3), st.floats(-2, 2))
@settings(max_examples=60, deadline=None)
def test_joint_transforms_agree_with_pytransform3d(direction, point, angle, distance):
    axis = direction / np.linalg.norm(direction)
    # the oracle parametrises by pitch: turn and slide one after the other instead
    turn = oracle.transform_from_exponential_coordinates(np.concatenate([axis, np.cross(point, axis)]) * angle)
    slide = np.eye(4)
    slide[:3, 3] = axis * distance
    ours = joint_transforms(point, np.concatenate([angle * axis, distance * axis]))
    np.testing.assert_allclose(ours, slide @ turn, atol=1e-9)
