from __future__ import annotations

import subprocess
import sys
from importlib import metadata, util
from pathlib import Path

import pytest

from schemas.errors import InputError, UnavailableError
from stages.ingest.roboart import description_digest, descriptions, own_descriptions, robot_names
from stages.ingest.roboart.clones import CloneError
from stages.ingest.roboart.descriptions import robot_description
from stages.ingest.roboart.mesh_files import mesh_references, resolve_mesh


@pytest.fixture
def offline(monkeypatch):
    def refuse(module):
        raise CloneError("no internet")

    monkeypatch.setattr(descriptions, "clone_description", refuse)


@pytest.fixture
def no_packages(monkeypatch):
    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(descriptions.metadata, "distribution", missing)


@pytest.fixture
def assets(tmp_path):
    """A user's folder with one robot."""
    folder = tmp_path / "assets" / "bolt"
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes" / "part.stl").write_bytes(b"first")
    mesh = '<visual><geometry><mesh filename="meshes/part.stl"/></geometry></visual>'
    (folder / "bolt.urdf").write_text(f'<robot name="bolt"><link name="a">{mesh}</link></robot>')
    return tmp_path / "assets"


def robot_digest(name: str, assets: Path | None = None) -> str:
    return description_digest(robot_description(name, assets))


def refusal(name: str, assets: Path | None = None) -> str:
    with pytest.raises(UnavailableError) as caught:
        robot_description(name, assets)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_dozen_robots_come_with_all_their_meshes_from_packages_alone(offline):
    digests = set()
    for name in robot_names():
        try:
            digests.add(robot_digest(name))
        except UnavailableError:
            continue
    assert len(digests) == (12 if util.find_spec("pybullet") else 11)  # pybullet has no wheel for every Python


def test_the_users_folder_comes_before_the_package_and_the_package_before_the_clone(assets, monkeypatch, no_packages):
    cloned = Path("/cloned.urdf"), (Path("/"),)
    monkeypatch.setattr(descriptions, "clone_description", lambda module: cloned)
    assert robot_description("bolt", assets).urdf_path == assets / "bolt" / "bolt.urdf"
    assert robot_description("bolt").urdf_path == cloned[0]
    assert robot_description("a1", assets).urdf_path == cloned[0]
    monkeypatch.undo()
    assert robot_description("bolt").urdf_path.parts[-3:] == ("bolt_description", "robots", "bolt.urdf")


@pytest.mark.usefixtures("offline", "no_packages")
def test_a_robot_that_cannot_be_had_is_reported_with_every_way_to_get_it(assets):
    message = refusal("a1", assets)
    for words in ("'a1'", "a1/a1.urdf", "pip install rearticulate[robots]", "no internet", "--assets", "REART_ASSETS"):
        assert words in message
    assert "pip" not in refusal("atlas")
    assert "github.com" in refusal("nao")
    assert "github.com" in refusal("spot")


def test_an_unknown_robot_is_not_looked_for():
    with pytest.raises(InputError, match=r"'r2d2'.*a1, allegro"):
        robot_digest("r2d2")


def test_the_digest_changes_with_a_mesh_and_with_the_urdf_and_not_with_the_folder(assets, tmp_path):
    digests = [robot_digest("bolt", assets)]
    assets = assets.rename(tmp_path / "elsewhere")
    assert robot_digest("bolt", assets) == digests[0]
    (assets / "bolt" / "meshes" / "part.stl").write_bytes(b"other")
    digests.append(robot_digest("bolt", assets))
    urdf_path = assets / "bolt" / "bolt.urdf"
    urdf_path.write_text(urdf_path.read_text().replace('"a"', '"b"'))
    digests.append(robot_digest("bolt", assets))
    assert len(set(digests)) == 3


def test_a_broken_urdf_or_a_missing_mesh_is_wrong_and_not_unavailable(assets):
    urdf_path = assets / "bolt" / "bolt.urdf"
    (assets / "bolt" / "meshes" / "part.stl").unlink()
    with pytest.raises(InputError, match=r"meshes/part\.stl") as caught:
        robot_digest("bolt", assets)
    assert not isinstance(caught.value, UnavailableError)
    urdf_path.write_text("<robot><link")
    with pytest.raises(InputError, match="XML") as caught:
        robot_digest("bolt", assets)
    assert not isinstance(caught.value, UnavailableError)


def test_names_and_digests_need_neither_torch_nor_open3d_nor_a_mesh_loader():
    code = (
        "import sys; from stages.ingest.roboart import description_digest, robot_description; "
        "description_digest(robot_description('bolt')); "
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


def test_a_users_descriptions_are_named_after_their_folder_or_after_it_and_their_file(tmp_path):
    for name in (
        "lamp.urdf",
        "100129/mobility.urdf",
        "arms/left.urdf",
        "arms/right.URDF",
        "meshes/a.stl",
        ".old/x.urdf",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("<robot/>")
    found = dict(own_descriptions(tmp_path))
    assert list(found) == ["lamp", "100129", "arms-left", "arms-right"]
    assert found["100129"].urdf_path == tmp_path / "100129" / "mobility.urdf"
    assert [name for name, _ in own_descriptions(tmp_path / "lamp.urdf")] == ["lamp"]
    with pytest.raises(InputError, match=r"meshes: found no URDF, expected NAME\.urdf or NAME/\*\.urdf there"):
        own_descriptions(tmp_path / "meshes")


def test_a_users_mesh_may_be_named_from_the_package_around_its_description(tmp_path):
    urdf_path = tmp_path / "arm_description" / "urdf" / "arm.urdf"
    urdf_path.parent.mkdir(parents=True)
    (tmp_path / "arm_description" / "part.stl").write_bytes(b"solid")
    urdf_path.write_text(
        '<robot><link><visual><mesh filename="package://arm_description/part.stl"/></visual></link></robot>'
    )
    [(_, found)] = own_descriptions(urdf_path)
    assert resolve_mesh(*mesh_references(urdf_path), found.urdf_path, found.mesh_dirs).read_bytes() == b"solid"


@pytest.mark.parametrize(
    "text", ['<?xml version="1.0" encoding="gb2312"?><robot/>', '<?xml version="1.0" encoding="x-none"?><robot/>']
)
def test_a_urdf_in_an_encoding_that_is_not_known_is_refused_by_name(tmp_path, text):
    (tmp_path / "odd.urdf").write_text(text)
    [(_, found)] = own_descriptions(tmp_path)
    with pytest.raises(InputError, match=r"odd\.urdf: cannot be read as XML"):
        description_digest(found)


def test_a_mesh_name_that_no_file_can_have_is_refused(tmp_path):
    mesh = f'<mesh filename="{"x" * 300}.stl"/>'
    (tmp_path / "odd.urdf").write_text(f"<robot><link><visual><geometry>{mesh}</geometry></visual></link></robot>")
    [(_, found)] = own_descriptions(tmp_path)
    with pytest.raises(InputError, match=r"x\.stl"):
        description_digest(found)
