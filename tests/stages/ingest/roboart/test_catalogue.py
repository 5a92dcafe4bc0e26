from __future__ import annotations

import subprocess
import sys
from importlib import metadata

import pytest

from schemas.errors import InputError
from stages.ingest.roboart import catalogue, robot_digest, robot_names
from stages.ingest.roboart.mesh_files import mesh_references, resolve_mesh


def test_the_nine_robots_are_there_with_all_their_meshes():
    assert robot_names() == ["a1", "allegro", "baxter", "bolt", "kinova", "laikago", "panda", "solo", "ur5"]
    assert len({robot_digest(name) for name in robot_names()}) == 9


def test_an_unknown_robot_is_refused_with_the_names_that_are_known():
    with pytest.raises(InputError, match=r"'r2d2'.*a1, allegro, baxter"):
        robot_digest("r2d2")


def test_without_the_package_the_message_says_what_to_install(monkeypatch):
    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(catalogue.metadata, "distribution", missing)
    with pytest.raises(InputError, match=r"pip install rearticulate\[robots\]"):
        robot_digest("bolt")


def test_the_digest_changes_with_a_mesh_and_with_the_urdf(urdf, monkeypatch):
    mesh = urdf.folder / "part.stl"
    mesh.write_bytes(b"first")
    path = urdf.write(urdf.link("a", urdf.shape('<mesh filename="part.stl"/>')))
    monkeypatch.setattr(catalogue, "robot_description", lambda name: (path, ()))
    digests = [robot_digest("tiny"), robot_digest("tiny")]
    mesh.write_bytes(b"other")
    digests.append(robot_digest("tiny"))
    path.write_text(path.read_text().replace("tiny", "other"))
    digests.append(robot_digest("tiny"))
    assert digests[0] == digests[1]
    assert len(set(digests)) == 3


def test_names_and_digests_need_neither_torch_nor_open3d_nor_a_mesh_loader():
    code = (
        "import sys; from stages.ingest.roboart import robot_digest; robot_digest('bolt'); "
        "print({'torch', 'open3d', 'trimesh', 'yourdfpy'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_package_names_are_looked_up_in_the_mesh_folders_and_others_beside_the_urdf(tmp_path):
    urdf_path = tmp_path / "robots" / "robot.urdf"
    for path in (tmp_path / "share/parts/a.stl", tmp_path / "robots/meshes/b.stl"):
        path.parent.mkdir(parents=True)
        path.touch()
    folders = [tmp_path, tmp_path / "share"]
    assert resolve_mesh("package://parts/a.stl", urdf_path, folders) == tmp_path / "share/parts/a.stl"
    assert resolve_mesh("meshes/b.stl", urdf_path, folders) == tmp_path / "robots/meshes/b.stl"
    with pytest.raises(InputError, match=r"package://parts/c\.stl"):
        resolve_mesh("package://parts/c.stl", urdf_path, folders)


def test_every_mesh_is_listed_once(urdf):
    mesh = urdf.shape('<mesh filename="b.stl"/>')
    path = urdf.write(urdf.link("a", mesh, mesh, urdf.shape('<mesh filename="a.stl"/>', role="collision")))
    assert mesh_references(path) == ["a.stl", "b.stl"]
