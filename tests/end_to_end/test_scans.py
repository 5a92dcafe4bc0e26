"""Scans as people have them: coloured meshes on a table, and depth images of several cameras."""

import json

import numpy as np
import pytest
import trimesh
from PIL import Image

from stages.ingest.point_formats import read_cloud

RED, BLUE, BROWN = (200, 30, 30, 255), (30, 30, 200, 255), (120, 90, 60, 255)


def boxes(t):
    """A red box on z = 0, and a blue one that turns about an edge of it."""
    still = trimesh.creation.box([1.0, 0.3, 0.4])
    still.apply_translation([-0.55, 0, 0.2])
    turning = trimesh.creation.box([1.0, 0.3, 0.4])
    turning.apply_translation([0.55, 0, 0.2])
    turning.apply_transform(trimesh.transformations.rotation_matrix(0.4 * t, [0, 0, 1]))
    for mesh, colour in ((still, RED), (turning, BLUE)):
        mesh.visual.vertex_colors = np.tile(colour, (8, 1)).astype(np.uint8)
    return still, turning


@pytest.fixture(scope="module")
def scanned(finished, tmp_path_factory):
    """Three scans as .glb, each with the table below, fitted."""
    place = type(finished)(tmp_path_factory.mktemp("scanned"), workdir_name="out/workdir")
    (place.folder / "lamp").mkdir()
    table = trimesh.creation.cylinder(1.6, 0.001)
    table.apply_translation([0, 0, -0.001])
    table.visual.vertex_colors = np.tile(BROWN, (len(table.vertices), 1)).astype(np.uint8)
    for t in range(3):
        scene = trimesh.Scene([*boxes(t), table])
        (place.folder / "lamp" / f"{t}.glb").write_bytes(scene.export(file_type="glb"))
    settings = ("ingest.clean.plane=true", "ingest.mesh.points=1500")
    words = [word for setting in settings for word in ("--set", setting)]
    outcome = place.reart("fit", "lamp", "--out", "out", "--units", "m", "--viewpoint", "-3,0,2.5", *words)
    assert (outcome.returncode, outcome.stderr) == (0, "")
    return type(finished)(place.folder, place.workdir_name, outcome)


def test_the_model_has_the_colours_of_the_scans_and_no_table(scanned):
    arrays = np.load(scanned.folder / "out" / "model.npz")
    assert arrays["canonical_points"][:, 2].min() > 0
    expected = np.where(arrays["canonical_points"][:, :1] < 0, RED[:3], BLUE[:3])
    assert arrays["colours"].dtype == np.uint8
    assert (arrays["colours"] == expected).all(axis=1).mean() > 0.98  # near the edge either box may be
    meshes = {path.name for path in (scanned.folder / "out" / "meshes").iterdir()}
    assert {"part_0.obj", "part_0_collision.stl"} <= meshes


def test_what_the_clean_up_took_is_said_and_kept(scanned):
    [line] = [line for line in scanned.outcome.stdout.splitlines() if line.startswith("the clean-up took")]
    assert "of 4,500 points" in line
    assert line in (scanned.folder / "out" / "report.html").read_text()
    [sequence] = [m["payload"]["sequence"] for name, m in scanned.manifests().items() if "/ingest-" in name]
    assert len(sequence["cleaned"]["plane"]) == 3
    assert min(sequence["cleaned"]["plane"]) > 500
    assert sequence["remarks"] == [line]


def test_a_pose_is_coloured_by_scan_or_by_part(scanned):
    (scanned.folder / "states.json").write_text("{}")
    colours = np.load(scanned.folder / "out" / "model.npz")["colours"]
    for words, by_scan in (((), True), (("--colours", "part"), False)):
        outcome = scanned.reart("pose", "out", "--states", "states.json", "--out", "posed", *words)
        assert (outcome.returncode, outcome.stderr) == (0, "")
        found = read_cloud(scanned.folder / "posed" / "posed.ply").colours
        assert np.array_equal(found, colours) == by_scan


def test_a_mesh_that_names_other_files_is_one_line_and_exit_code_2(finished, tmp_path):
    (tmp_path / "frames").mkdir()
    for t in range(2):
        files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(list(boxes(t))))
        (tmp_path / "frames" / f"{t}.gltf").write_bytes(files["model.gltf"])
        (tmp_path / "frames" / next(name for name in files if name.endswith(".bin"))).write_bytes(b"")
    outcome = type(finished)(tmp_path).reart("fit", "frames", "--out", "out")
    assert outcome.returncode == 2
    [error] = outcome.stderr.splitlines()
    assert "0.gltf: found a reference to another file" in error
    assert "export it as .glb" in error


def seen(t, eye, rows=60, columns=80, focal=70.0):
    """A depth image in millimetres of the boxes, whose camera stands at `eye` and looks at the origin; and its pose."""
    forwards = -np.array(eye) / np.linalg.norm(eye)
    right = np.cross(forwards, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.stack([right, np.cross(forwards, right), forwards], axis=1), eye
    v, u = np.mgrid[:rows, :columns]
    rays = np.stack([(u - columns / 2) / focal, (v - rows / 2) / focal, np.ones_like(u)], axis=-1).reshape(-1, 3)
    scene = trimesh.util.concatenate(boxes(t))
    origins = np.tile(eye, (len(rays), 1))
    places, index, _ = trimesh.ray.ray_triangle.RayMeshIntersector(scene).intersects_location(
        origins, rays @ T[:3, :3].T, multiple_hits=False
    )
    depth = np.zeros(rows * columns)
    depth[index] = (places - eye) @ forwards * 1000
    return depth.reshape(rows, columns).round().astype(np.uint16), T


def test_depth_images_of_two_cameras_become_a_model_in_metres(finished, tmp_path):
    lamp = tmp_path / "lamp"
    (lamp / "poses").mkdir(parents=True)
    matrix = [70.0, 0, 0, 0, 70.0, 0, 40.0, 30.0, 1]
    (lamp / "intrinsics.json").write_text(json.dumps({"width": 80, "height": 60, "intrinsic_matrix": matrix}))
    for t in range(3):
        (lamp / "depth" / f"state_{t}").mkdir(parents=True)
        for name, eye in (("left", (-1.5, -2.0, 1.5)), ("right", (1.5, 2.0, 1.5))):
            image, T = seen(t, eye)
            Image.fromarray(image).save(lamp / "depth" / f"state_{t}" / f"{name}.png")
            np.savetxt(lamp / "poses" / f"{name}.txt", T)
    place = type(finished)(tmp_path, workdir_name="out/workdir")
    outcome = place.reart("fit", "lamp", "--out", "out")
    assert (outcome.returncode, outcome.stderr) == (0, "")
    assert json.loads((tmp_path / "out" / "model.json").read_text())["units"] == "metre"
    points = np.load(tmp_path / "out" / "model.npz")["canonical_points"]
    np.testing.assert_allclose([points[:, 2].min(), points[:, 2].max()], [0, 0.4], atol=0.02)
    [ingest] = [m for name, m in place.manifests().items() if "/ingest-" in name]
    assert [entry["shape"] for entry in ingest["arrays"] if entry["name"] == "sequence/viewpoints"] == [[3, 2, 3]]
