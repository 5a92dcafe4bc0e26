"""Geo-referenced coordinates: an object of half a metre, thousands of kilometres from where they count from."""

import io

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy

from schemas.config import ExportConfig
from stages.export.stage import WRITERS, compute_export
from stages.kernels.points.sampling import point_spacing
from stages.result.stage import result_files

FINE = 1e-6  # of the points' spacing: what is told of motions is as fine


@pytest.fixture
def exported(near_and_far, tmp_path):
    scene, result = near_and_far[1]
    frames = [scene.sequence.to_input(frame) for frame in scene.sequence.frames()]
    robot = compute_export(result, frames, ExportConfig(triangles=400), "far")
    (tmp_path / "meshes").mkdir()
    for write in WRITERS.values():
        for file, content in write(robot).items():
            (tmp_path / file).write_bytes(content)
    return result, robot, tmp_path


def posed(T, p):
    return p @ T[:3, :3].T + T[:3, 3]


def test_the_points_keep_their_digits_and_the_version_says_so(near_and_far):
    (_, near), (scene, far) = near_and_far
    assert (near.canonical_points.dtype, near.model.version) == (np.float32, 1)
    assert (far.canonical_points.dtype, far.model.version) == (np.float64, 2)
    p = scene.sequence.to_input(scene.sequence.frames()[far.model.canonical_frame])
    with np.load(io.BytesIO(result_files(far)["model.npz"])) as arrays:
        np.testing.assert_array_equal(arrays["canonical_points"], p)


def test_the_formula_of_the_readme_moves_points_as_near_the_origin(near_and_far, away):
    (_, near), (_, far) = near_and_far
    for part in (0, 1):
        own = near.labels == part
        for T_near, T_away in zip(near.T_frame_canonical[:, part], far.T_frame_canonical[:, part], strict=True):
            expected = posed(T_near, near.canonical_points[own].astype(np.float64)) + away
            found = posed(T_away, far.canonical_points[own])
            np.testing.assert_allclose(found, expected, rtol=0, atol=2e-8)  # 32 bits of the near ones


def test_a_joints_point_lies_on_its_axis_next_to_its_part(near_and_far, away):
    (_, near), (_, far) = near_and_far
    [joint], [other] = far.model.joints, near.model.joints
    child = far.canonical_points[far.labels == joint.child]
    assert np.linalg.norm(child - joint.point, axis=1).min() < 0.1
    np.testing.assert_allclose(np.subtract(joint.point, away), other.point, atol=1e-8)


def test_meshes_are_as_large_as_near_the_origin_and_closed(exported):
    result, robot, folder = exported
    for mesh in robot.meshes:
        loaded = trimesh.load(folder / mesh.file)
        assert mesh.closed
        assert loaded.is_watertight
        assert np.abs(loaded.vertices).max() < 0.5
        own = result.canonical_points[result.labels == mesh.link]
        middle = loaded.bounds.mean(axis=0) + robot.links[mesh.link].origin
        np.testing.assert_allclose(middle, (own.min(axis=0) + own.max(axis=0)) / 2, atol=0.02)


def test_simulators_move_every_part_as_the_model_says(exported):
    result, robot, folder = exported
    tolerance = FINE * point_spacing(result.canonical_points) + 2e-9  # which is what 64 bits hold there
    loaded = yourdfpy.URDF.load(str(folder / "robot.urdf"))
    assert loaded.validate()
    [joint] = robot.joints
    models = {file: mujoco.MjModel.from_xml_path(str(folder / file)) for file in ("robot.urdf", "robot.xml")}
    for t in range(result.model.frames):
        Ts = result.T_frame_canonical[t]
        own = result.canonical_points[result.labels == 1]
        in_link = own - robot.links[1].origin
        seen_from_root = posed(np.linalg.inv(Ts[0]) @ Ts[1], own)
        loaded.update_cfg({joint.name: joint.states[t]})
        found = posed(loaded.get_transform("part_1", "part_0"), in_link)
        np.testing.assert_allclose(found, seen_from_root, rtol=0, atol=tolerance)
        for file, model in models.items():
            data = mujoco.MjData(model)
            if file == "robot.xml":
                mujoco.mj_resetDataKeyframe(model, data, t)
            else:
                data.qpos[:] = joint.states[t]
            mujoco.mj_kinematics(model, data)
            body = model.body("part_1").id
            found = in_link @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
            expected = posed(Ts[1], own) if file == "robot.xml" else seen_from_root
            np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def test_the_shapes_of_the_root_lie_where_the_object_does(exported):
    result, _, folder = exported
    root = result.canonical_points[result.labels == 0]
    box = np.stack([root.min(axis=0), root.max(axis=0)])
    scene = yourdfpy.URDF.load(str(folder / "robot.urdf")).scene
    np.testing.assert_allclose(scene.bounds.mean(axis=0), result.canonical_points.mean(axis=0), atol=0.1)
    for file in ("robot.urdf", "robot.xml"):
        model = mujoco.MjModel.from_xml_path(str(folder / file))
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        visible = [
            geom for geom in range(model.ngeom) if np.allclose(data.geom_xpos[geom], box.mean(axis=0), atol=0.05)
        ]
        assert visible


@pytest.mark.parametrize("file", ["robot.urdf", "robot.xml"])
def test_a_hundred_steps_stay_finite_without_a_warning(exported, file):
    model = mujoco.MjModel.from_xml_path(str(exported[2] / file))
    data = mujoco.MjData(model)
    for _ in range(100):
        mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all()
    assert all(warning.number == 0 for warning in data.warning)
