"""URDF and MJCF as other programs understand them."""

import io
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy

from schemas.config import ExportConfig
from stages.export.markup import stl
from stages.export.stage import WRITERS, compute_export


@pytest.fixture(params=["hinge", "drawer", "hinge on a moving base"])
def exported(request, fit_of, tmp_path):
    """A fit, its description, and both files written."""
    name, _, moving = request.param.partition(" ")
    result = fit_of(request.getfixturevalue(name), free=bool(moving))
    robot = compute_export(result, None, ExportConfig(triangles=400), "box & <lid>")
    (tmp_path / "meshes").mkdir()
    for write in WRITERS.values():
        for file, content in write(robot).items():
            (tmp_path / file).write_bytes(content)
    return result, robot, tmp_path


def load(folder, file):
    model = mujoco.MjModel.from_xml_path(str(folder / file))
    return model, mujoco.MjData(model)


def T_world_body(model, data, name):
    body = model.body(name).id
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
    return T


def T_frame_canonical(T_world_link, link):
    """Where a link's frame stands, as a motion of the canonical frame's points."""
    return T_world_link @ np.block([[np.eye(3), -np.array(link.origin)[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])


def test_the_key_frames_of_the_mjcf_put_every_part_where_the_model_says(exported):
    result, robot, folder = exported
    model, data = load(folder, "robot.xml")
    assert model.nkey == result.model.frames
    for t in range(model.nkey):
        mujoco.mj_resetDataKeyframe(model, data, t)
        mujoco.mj_forward(model, data)
        for part, link in enumerate(robot.links):
            T = T_frame_canonical(T_world_body(model, data, link.name), link)
            assert pytest.approx(result.T_frame_canonical[t, part], abs=1e-9) == T


def test_the_urdf_puts_the_child_where_the_model_says_seen_from_the_root(exported):
    result, robot, folder = exported
    loaded = yourdfpy.URDF.load(str(folder / "robot.urdf"))
    model, data = load(folder, "robot.urdf")
    assert loaded.validate()
    [joint] = robot.joints
    for t, state in enumerate(joint.states):
        T_root_child = np.linalg.inv(result.T_frame_canonical[t, 0]) @ result.T_frame_canonical[t, 1]
        loaded.update_cfg({joint.name: state})
        T = loaded.get_transform("part_1", "part_0")
        assert T_frame_canonical(T, robot.links[1]) == pytest.approx(T_root_child, abs=1e-9)
        data.qpos[:] = state
        mujoco.mj_forward(model, data)
        T = T_frame_canonical(T_world_body(model, data, "part_1"), robot.links[1])
        assert pytest.approx(T_root_child, abs=1e-9) == T


@pytest.mark.parametrize("file", ["robot.urdf", "robot.xml"])
def test_a_thousand_steps_stay_finite_without_a_warning(exported, file):
    model, data = load(exported[2], file)
    for _ in range(1000):
        mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all()
    assert all(warning.number == 0 for warning in data.warning)


@pytest.mark.parametrize("writer", WRITERS)
def test_links_that_overlap_are_not_flung_apart(hinge, fit_of, tmp_path, writer):
    robot = compute_export(fit_of(hinge), None, ExportConfig(triangles=400), "box")
    files = WRITERS[writer](robot.replace(vertices=1.5 * robot.vertices))
    (tmp_path / "meshes").mkdir()
    for file, content in files.items():
        (tmp_path / file).write_bytes(content)
    model, data = load(tmp_path, next(iter(files)))
    mujoco.mj_step(model, data)
    assert data.ncon == 0
    assert np.abs(data.qvel).max() < 0.2


def test_limits_masses_and_inertias_are_those_of_the_description(exported):
    _, robot, folder = exported
    for file in ("robot.urdf", "robot.xml"):
        model, _ = load(folder, file)
        body, joint = model.body("part_1"), model.joint("joint_0_1")
        assert joint.range == pytest.approx([robot.joints[0].lower, robot.joints[0].upper])
        assert body.mass == pytest.approx(robot.links[1].mass)
        xx, yy, zz, xy, xz, yz = robot.links[1].inertia
        principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert sorted(body.inertia) == pytest.approx(principal)


def test_mujoco_keeps_the_visible_meshes_of_both_files(exported):
    for file in ("robot.urdf", "robot.xml"):
        assert load(exported[2], file)[0].nmesh == 4


def test_only_a_moving_base_has_a_free_joint(exported):
    _, robot, folder = exported
    root = ET.parse(folder / "robot.xml")
    assert len(root.findall(".//freejoint")) == robot.free_base
    assert ET.parse(folder / "robot.urdf").find("joint[@type='floating']") is None


def test_every_mesh_is_closed_and_named_by_a_relative_path(exported):
    _, robot, folder = exported
    for mesh in robot.meshes:
        assert mesh.closed
        assert trimesh.load(folder / mesh.file).is_watertight
    named = {element.get("filename") for element in ET.parse(folder / "robot.urdf").iter("mesh")}
    assert named == {mesh.file for mesh in robot.meshes} == {f"meshes/{path.name}" for path in folder.glob("meshes/*")}


def test_links_that_touch_do_not_collide_in_the_mjcf(exported):
    excluded = ET.parse(exported[2] / "robot.xml").find("contact/exclude")
    assert (excluded.get("body1"), excluded.get("body2")) == ("part_0", "part_1")


def test_the_file_says_what_it_took_a_unit_for_and_which_meshes_are_open(exported, fit_of, hinge):
    result = fit_of(hinge)
    unknown = result.replace(model=result.model.model_copy(update={"units": "unknown"}))
    robot = compute_export(unknown, None, ExportConfig(triangles=400), "box")
    robot = robot.replace(meshes=tuple(mesh.model_copy(update={"closed": mesh.link == 0}) for mesh in robot.meshes))
    for writer in WRITERS.values():
        text = next(iter(writer(robot).values())).decode()
        assert "an unknown unit) = 1 m" in text
        assert "not closed: meshes/part_1.stl" in text


def test_stl_is_read_back_as_it_was():
    vertices, triangles = np.eye(4, 3), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    mesh = trimesh.load(io.BytesIO(stl(vertices, triangles)), file_type="stl", process=False)
    assert mesh.triangles == pytest.approx(vertices[triangles])
