"""A joint of any kind is fitted, posed and exported: balls, and a kind that this file alone adds."""

import mujoco
import numpy as np
import pytest
import yourdfpy
from scipy.spatial.transform import Rotation

from schemas.config import ExportConfig, FinalFitConfig, ProjectionConfig
from schemas.flow import Flow
from schemas.joints import JOINT_KINDS, JointKind
from schemas.model_file import ModelFile
from schemas.sequence import PointSequence
from stages.export.stage import WRITERS, compute_export
from stages.export.urdf import hinges
from stages.final_fit.stage import compute_final_fit
from stages.projection.stage import link_parts
from stages.rearticulation.posing import pose_by_states, pose_by_targets
from stages.result.stage import compute_result

FRAMES, CANONICAL, SCALE = 7, 3, 2.0
CENTRE = np.array([1.0, 0.0, -1.0])
TURNS = np.array([-0.9, -0.5, -0.2, 0.0, 0.4, 0.7, 1.1])
SLIDES = np.array([0.1, -0.12, 0.15, 0.0, -0.1, 0.12, -0.05])
BALL = np.stack([TURNS, 3 * SLIDES, np.roll(TURNS, 2) - TURNS[1]], axis=1) * [0.6, 1.0, 0.4]
BALL[CANONICAL] = 0.0
AXIS, POINT = np.array([0.0, 0.0, 1.0]), np.array([0.1, 0.0, 0.2])
STATES = {"cylindrical": np.stack([TURNS, SLIDES], axis=1), "spherical": BALL}


@pytest.fixture(scope="module")
def cylindrical():
    """A joint that turns about its axis and slides along it: one row of the table."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(JOINT_KINDS, "cylindrical", JointKind("cylindrical", "C", "axis", "axis"))
        yield


BOXES = (([-0.3, -0.25, -0.1], [0.3, 0.25, 0.1]), ([0.02, -0.05, 0.2], [0.18, 0.3, 0.45]))


def boxes(rng, count):
    """Points of a base, and of an arm above it that no turn leaves as it is."""
    clouds = []
    for low, high in map(np.array, BOXES):
        points, face = rng.uniform(low, high, size=(count, 3)), rng.integers(6, size=count)
        points[np.arange(count), face % 3] = np.where(face < 3, low[face % 3], high[face % 3])
        clouds.append(points)
    return clouds


def motions(turns, slides):
    """The motions of base and arm; the arm turns about POINT, then slides."""
    Ts = np.tile(np.eye(4), (FRAMES, 2, 1, 1))
    R = Rotation.from_rotvec(turns).as_matrix()
    Ts[:, 1, :3, :3], Ts[:, 1, :3, 3] = R, POINT + slides - R @ POINT
    return Ts


def sequence_of(Ts):
    frames = []
    for t in range(FRAMES):
        base, arm = boxes(np.random.default_rng(t), 400)
        frames.append(np.concatenate([base, arm @ Ts[t, 1, :3, :3].T + Ts[t, 1, :3, 3]]))
    return PointSequence(
        points=np.concatenate(frames),
        point_counts=np.full(FRAMES, 800),
        dropped_counts=np.zeros(FRAMES, dtype=np.int64),
        scale=SCALE,
        centre=tuple(CENTRE),
        units="metre",
        frame_names=tuple(f"frame_{t}" for t in range(FRAMES)),
    )


def fit(sequence, Ts, kinds):
    """The fit of parts whose motions are a little off."""
    noisy = Ts.copy()
    noisy[:, 1, :3, 3] += np.random.default_rng(0).normal(scale=0.005, size=(FRAMES, 3))
    noisy[CANONICAL] = np.eye(4)
    projection = ProjectionConfig(joints=kinds)
    start = link_parts(sequence.frames()[CANONICAL], np.repeat([0, 1], 400), noisy, CANONICAL, projection)
    none = Flow(
        pair_frames=np.stack([np.arange(FRAMES - 1), np.arange(1, FRAMES)], axis=1),
        pair_costs=np.zeros(FRAMES - 1),
        match_counts=np.zeros(FRAMES - 1, dtype=np.int64),
        source_index=np.zeros(0, dtype=np.int64),
        target_index=np.zeros(0, dtype=np.int64),
        flow=np.zeros((0, 3)),
        confidence=np.zeros(0),
    )
    # a further link explains a ball joint's motion about as well, so balls are looked for without
    config = FinalFitConfig(points=800, energy_points=200, hidden_links="spherical" not in kinds)
    return compute_final_fit(start, sequence, none, config, np.random.default_rng(0), kinds=projection.kinds)


@pytest.fixture(params=["cylindrical", "spherical"], scope="module")
def case(request, cylindrical):
    """The kind, the true motions of base and arm, and the sequence."""
    states = STATES[request.param]
    still = np.zeros((FRAMES, 3))
    Ts = motions(states, still) if request.param == "spherical" else motions(states[:, :1] * AXIS, states[:, 1:] * AXIS)
    return request.param, Ts, sequence_of(Ts)


@pytest.fixture(scope="module")
def fitted(case):
    kind, Ts, sequence = case
    return fit(sequence, Ts, ("revolute", "prismatic", kind))


def test_the_kind_is_found_among_others_and_fitted(case, fitted):
    kind, Ts, _ = case
    assert fitted.joint_types == (kind,)
    assert fitted.labels.tolist() == [0] * 400 + [1] * 400
    np.testing.assert_allclose(fitted.Ts_frame_canonical, Ts, atol=0.02)
    if kind == "spherical":
        np.testing.assert_allclose(fitted.point[0], POINT, atol=0.01)
        np.testing.assert_allclose(fitted.states, STATES[kind], atol=0.03)
    else:
        assert abs(fitted.axis[0] @ AXIS) > np.cos(np.radians(1))
        assert np.linalg.norm(np.cross(fitted.point[0] - POINT, AXIS)) < 0.005
        sign = np.sign(fitted.axis[0] @ AXIS)
        np.testing.assert_allclose(sign * fitted.states, STATES[kind], atol=0.02)


@pytest.mark.parametrize(
    ("turns", "slides", "kind"), [(TURNS, 0 * TURNS, "revolute"), (0 * TURNS, SLIDES, "prismatic")]
)
def test_plain_joints_stay_plain(cylindrical, turns, slides, kind):
    Ts = motions(turns[:, None] * AXIS, slides[:, None] * AXIS)
    model = fit(sequence_of(Ts), Ts, ("revolute", "prismatic", "cylindrical", "spherical"))
    assert model.joint_types == (kind,)


def test_a_model_of_that_kind_is_written_read_and_posed(case, fitted):
    kind, _, sequence = case
    result = compute_result(fitted, sequence)
    read = ModelFile.model_validate_json(result.model.model_dump_json())
    assert read == result.model
    [joint] = read.joints
    assert len(joint.lowers) == (1 if kind == "spherical" else 2)
    for t in (0, 5):
        posed = pose_by_states(result, {joint.name: joint.states[t]}, np.eye(4))
        np.testing.assert_allclose(posed.Ts_pose_canonical, result.T_frame_canonical[t], atol=1e-9)
    rng = np.random.default_rng(1)
    source = result.canonical_points[rng.choice(np.flatnonzero(result.labels == 1), 5)].astype(np.float64)
    target = source @ result.T_frame_canonical[6, 1, :3, :3].T + result.T_frame_canonical[6, 1, :3, 3]
    for limits in (False, True):
        posed = pose_by_targets(result, source, target, limits=limits)
        assert posed.pose.targets.greatest < 1e-5
        np.testing.assert_allclose(np.atleast_1d(posed.pose.states[joint.name]), joint.states[6], atol=1e-4)


def test_simulators_put_the_arm_where_the_model_says(case, fitted, tmp_path):
    kind, _, sequence = case
    result = compute_result(fitted, sequence)
    robot = compute_export(result, None, ExportConfig(triangles=200), "arm")
    (tmp_path / "meshes").mkdir()
    for write in WRITERS.values():
        for file, content in write(robot).items():
            (tmp_path / file).write_bytes(content)
    origin = np.eye(4)
    origin[:3, 3] = robot.links[1].origin
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    data = mujoco.MjData(model)
    expected = ["joint_0_1"] if kind == "spherical" else ["joint_0_1_slide", "joint_0_1_turn"]
    assert [model.joint(index).name for index in range(model.njnt)] == expected
    for t in range(FRAMES):
        mujoco.mj_resetDataKeyframe(model, data, t)
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(world(model, data), result.T_frame_canonical[t, 1] @ origin, atol=1e-9)
    urdf = yourdfpy.URDF.load(str(tmp_path / "robot.urdf"))
    assert urdf.validate()
    simulated = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.urdf"))
    assert simulated.nq == (3 if kind == "spherical" else 2)
    joints = [hinge for joint in robot.joints for hinge in hinges(joint)]
    for t in range(FRAMES):
        urdf.update_cfg({joint.name: joint.states[t] for joint in joints})
        T_root_child = urdf.get_transform("part_1", "part_0")
        np.testing.assert_allclose(T_root_child, result.T_frame_canonical[t, 1] @ origin, atol=1e-9)
        positions = mujoco.MjData(simulated)
        for joint in joints:
            positions.joint(joint.name).qpos[:] = joint.states[t]
        mujoco.mj_forward(simulated, positions)
        np.testing.assert_allclose(world(simulated, positions), result.T_frame_canonical[t, 1] @ origin, atol=1e-9)
    for _ in range(200):
        mujoco.mj_step(simulated, positions)
    assert np.isfinite(positions.qpos).all()


def world(model, data):
    body = model.body("part_1").id
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
    return T


def test_an_unknown_kind_is_named_with_those_that_there_are():
    with pytest.raises(ValueError, match="expected one of revolute, prismatic, spherical"):
        ProjectionConfig(joints=("revolute", "ball"))
