from __future__ import annotations

import socket
import time

import pytest

from stages.ingest.roboart import clones
from stages.ingest.roboart.clones import CloneError, clone_description


@pytest.fixture
def library(tmp_path, monkeypatch):
    """A stand-in for robot_descriptions, whose modules clone when they are imported."""
    folder = tmp_path / "library" / "tiny_descriptions"
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()
    (folder / "arm_description.py").write_text(
        "import os\nprint('Cloning...')\nPACKAGE_PATH = '/cache/repository/arm'\n"
        "URDF_PATH = PACKAGE_PATH + '/' + os.environ.get('GIT_ALLOW_PROTOCOL', 'any') + '.urdf'\n"
    )
    (folder / "lost_description.py").write_text("raise RuntimeError('the repository has moved')")
    (folder / "slow_description.py").write_text("import time; time.sleep(60)")
    monkeypatch.setattr(clones, "LIBRARY", "tiny_descriptions")
    monkeypatch.setenv("PYTHONPATH", str(folder.parent))
    monkeypatch.syspath_prepend(folder.parent)
    clones._online.cache_clear()
    yield folder
    clones._online.cache_clear()


@pytest.fixture
def host(monkeypatch):
    """A socket of this machine that stands in for the repositories' host; closed, nobody answers."""
    for name in ("https_proxy", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    with socket.create_server(("127.0.0.1", 0)) as server:
        monkeypatch.setattr(clones, "HOST", server.getsockname())
        yield server


@pytest.mark.usefixtures("library", "host")
def test_a_clone_gives_the_urdf_and_the_folders_of_its_package():
    urdf_path, mesh_dirs = clone_description("arm")
    assert str(urdf_path) == "/cache/repository/arm/any.urdf"
    assert list(map(str, mesh_dirs)) == ["/cache/repository", "/cache/repository/arm"]


@pytest.mark.usefixtures("library")
def test_without_the_host_only_an_earlier_clone_is_taken(host):
    host.close()
    assert clone_description("arm")[0].name == "file.urdf"  # git may use local repositories only
    with pytest.raises(CloneError, match=r"127\.0\.0\.1 is out of reach"):
        clone_description("lost")


@pytest.mark.usefixtures("library", "host")
def test_why_a_clone_failed_is_told_in_one_line():
    with pytest.raises(CloneError, match="the repository has moved") as caught:
        clone_description("lost")
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("library", "host")
def test_a_clone_that_hangs_is_given_up(monkeypatch):
    monkeypatch.setattr(clones, "CLONE_SECONDS", 0.5)
    start = time.monotonic()
    with pytest.raises(CloneError, match=r"within 0\.5 s"):
        clone_description("slow")
    assert time.monotonic() - start < 10


def test_without_the_library_its_name_is_told(monkeypatch):
    monkeypatch.setattr(clones, "LIBRARY", "no_such_library")
    with pytest.raises(CloneError, match="no_such_library"):
        clone_description("arm")
