"""Colours of the scans on the exported meshes, as other programs read them."""

import io

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy

from schemas.config import ExportConfig
from stages.export.geometry import fuse, vertex_colours
from stages.export.stage import WRITERS, compute_export

CONFIG = ExportConfig(triangles=400)
PARTS = np.array([[250, 20, 10], [10, 30, 240]], dtype=np.uint8)


@pytest.fixture
def painted(hinge, fit_of):
    """A fit whose parts have a colour each in all frames, and these frames with their colours."""
    result = fit_of(hinge)
    frames = [hinge.sequence.to_input(frame) for frame in hinge.sequence.frames()]
    return result.replace(colours=PARTS[hinge.canonical_labels]), frames, [PARTS[labels] for labels in hinge.labels]


def written(robot, folder):
    (folder / "meshes").mkdir()
    for write in WRITERS.values():
        for file, content in write(robot).items():
            (folder / file).write_bytes(content)


def test_fused_points_keep_the_colours_of_their_own_frames(painted):
    result, frames, colours = painted
    cloud = fuse(result, frames, 3.0, colours)
    assert np.array_equal(cloud.colours, PARTS[cloud.labels])
    assert fuse(result, frames, 3.0).colours is None
    assert np.array_equal(fuse(result, None, 3.0).colours, result.colours)


def test_visible_meshes_have_the_colours_and_other_programs_read_them(painted, tmp_path):
    result, frames, colours = painted
    robot = compute_export(result, frames, CONFIG, "box", colours)
    written(robot, tmp_path)
    for part in (0, 1):
        mesh = trimesh.load(tmp_path / "meshes" / f"part_{part}.obj", process=False)
        assert mesh.is_watertight
        assert np.abs(mesh.visual.vertex_colors[:, :3].astype(int) - PARTS[part]).max() <= 1
        assert (tmp_path / "meshes" / f"part_{part}_collision.stl").exists()
    assert not (tmp_path / "meshes" / "part_0.stl").exists()
    for file in ("robot.urdf", "robot.xml"):
        model = mujoco.MjModel.from_xml_path(str(tmp_path / file))
        assert model.nmesh == 4
    loaded = yourdfpy.URDF.load(str(tmp_path / "robot.urdf"))
    assert loaded.validate()
    assert all(visual.material is None for link in loaded.robot.links for visual in link.visuals)


def test_without_colours_of_all_points_the_meshes_are_as_ever(painted):
    result, frames, colours = painted
    plain = result.replace(colours=None)
    expected = [write(compute_export(plain, frames, CONFIG, "box")) for write in WRITERS.values()]
    assert "meshes/part_0.stl" in expected[0]
    for other in (
        compute_export(result, frames, CONFIG, "box"),
        compute_export(plain, frames, CONFIG, "box", colours),
    ):
        assert [write(other) for write in WRITERS.values()] == expected


def test_the_meshes_have_the_same_shape_with_colours(painted):
    result, frames, colours = painted
    robot = compute_export(result, frames, CONFIG, "box", colours)
    plain = compute_export(result.replace(colours=None), frames, CONFIG, "box")
    assert np.array_equal(robot.vertices, plain.vertices)
    assert np.array_equal(robot.triangles, plain.triangles)


def test_a_vertex_has_the_mean_colour_of_the_points_next_to_it():
    points = np.array([[0.0, 0, 0], [0, 0, 0.1], [0, 0.1, 0], [0.1, 0, 0], [9, 9, 9]])
    colours = np.array([[0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100], [255, 255, 255]], dtype=np.uint8)
    assert vertex_colours(np.zeros((1, 3)), points, colours).tolist() == [[25, 25, 25]]
    assert vertex_colours(np.zeros((2, 3)), points[:1], colours[1:2]).tolist() == [[100, 0, 0]] * 2


def test_a_part_without_points_has_no_colours(painted):
    result, _, _ = painted
    robot = compute_export(result.replace(labels=np.zeros_like(result.labels)), None, CONFIG, "box")
    files = WRITERS["urdf"](robot)
    assert [name for name in files if name.endswith(".obj")] == ["meshes/part_0.obj"]
    assert trimesh.load(io.BytesIO(files["meshes/part_0.obj"]), file_type="obj").is_watertight
