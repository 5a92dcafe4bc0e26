from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from schemas.config import IngestConfig
from schemas.errors import InputError
from stages.ingest.formats import dfaust
from stages.ingest.sources import list_sources

h5py = pytest.importorskip("h5py")
VERTICES, FRAMES = 300, 30


def sphere() -> tuple[np.ndarray, np.ndarray]:
    """A sphere of about 300 vertices, and its triangles."""
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(0).normal(size=(VERTICES, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points, ConvexHull(points).simplices.astype(np.uint32)


def registrations(frames: int = FRAMES) -> np.ndarray:
    """(vertices, 3, frames), as in D-FAUST: a sphere that swells."""
    points = sphere()[0]
    return np.stack([points * (1 + 0.02 * t) for t in range(frames)], axis=-1).astype(np.float32)


def write(path: Path, **entries: np.ndarray) -> Path:
    with h5py.File(path, "w") as file:
        for name, entry in ({"faces": sphere()[1]} | entries).items():
            if entry is not None:
                file.create_dataset(name, data=entry)
    return path


@pytest.fixture
def data(tmp_path) -> Path:
    return write(
        tmp_path / "registrations_m.hdf5", **{"50004_hopping": registrations(), "50009_punching": registrations(9)}
    )


def config(**settings) -> IngestConfig:
    return IngestConfig(
        source="dfaust", units="metre", **({"registrations": {"points": 200, "frames": 5}, "every": 6} | settings)
    )


def sources(data: Path | None) -> dict:
    return {source.name: source for source in list_sources(config(), data)}


def load(data: Path, name: str = "50004_hopping", **settings):
    return sources(data)[name].load(config(**settings), np.random.default_rng(0))


def refusal(action) -> str:
    with pytest.raises(InputError) as caught:
        action()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_sequences_are_the_arrays_beside_the_faces(data, tmp_path):
    assert list(sources(data)) == ["50004_hopping", "50009_punching"]
    write(tmp_path / "registrations_f.hdf5", **{"50020_jiggle": registrations(3)})
    assert list(sources(tmp_path)) == ["50020_jiggle", "50004_hopping", "50009_punching"]
    write(tmp_path / "again.h5", **{"50020_jiggle": registrations(3)})
    assert "twice" in refusal(lambda: sources(tmp_path))


def test_a_sequence_is_every_sixth_frame_sampled_anew_with_its_surface_and_no_parts(data):
    ingested = load(data)
    sequence = ingested.sequence
    assert sequence.frame_names == tuple(f"registrations_m.hdf5: 50004_hopping[{t}]" for t in (0, 6, 12, 18, 24))
    assert sequence.point_counts.tolist() == [200] * 5
    assert (sequence.units, ingested.truth) == ("metre", None)
    p = sequence.to_input(ingested.on_surface(2))
    size = np.linalg.norm(p, axis=-1)
    np.testing.assert_allclose(size / size[2], np.tile(((1 + 0.12 * np.arange(5)) / 1.24)[:, None], 200), rtol=1e-5)
    on_vertex = np.isclose(np.linalg.norm(sequence.to_input(sequence.frames()[0]), axis=1), 1, atol=1e-4)
    assert on_vertex.mean() < 0.5


def test_without_faces_vertices_are_drawn(tmp_path):
    data = write(tmp_path / "a.hdf5", s=registrations(), faces=None)
    p = load(data, "s").sequence
    np.testing.assert_allclose(np.linalg.norm(p.to_input(p.frames()[0]), axis=1), 1, atol=1e-5)


def test_a_digest_is_of_the_numbers_of_its_sequence(data, tmp_path):
    digests = {name: source.digest() for name, source in sources(data).items()}
    other = write(tmp_path / "b.hdf5", **{"50004_hopping": registrations(), "50009_punching": registrations(10)})
    again = {name: source.digest() for name, source in sources(other).items()}
    assert digests["50004_hopping"] == again["50004_hopping"]
    assert digests["50009_punching"] != again["50009_punching"]


def test_what_is_no_hdf5_file_is_refused(tmp_path, data):
    text = tmp_path / "text.hdf5"
    text.write_text("no registrations")
    assert "text.hdf5: is no HDF5 file" in refusal(lambda: sources(text))
    cut = tmp_path / "cut.hdf5"
    cut.write_bytes(data.read_bytes()[:3000])
    assert "cut.hdf5: " in refusal(lambda: load(cut))
    (tmp_path / "empty").mkdir()
    assert "ingest.correspond=true" in refusal(lambda: sources(tmp_path / "empty"))
    assert "check the path" in refusal(lambda: sources(tmp_path / "absent.hdf5"))
    assert "--data" in refusal(lambda: sources(None))
    assert "found no sequence" in refusal(lambda: sources(write(tmp_path / "none.hdf5")))


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (registrations().transpose(2, 0, 1), r"shape \(30, 300, 3\).*expected \(vertices, 3, frames\)"),
        (registrations()[..., 0], r"shape \(300, 3\)"),
        (np.array([b"text"]), r"shape \(1,\) of"),
        (registrations(1), "found 1 frames"),
        (np.where(np.arange(FRAMES) == 12, np.nan, registrations()), r"\[12\].*NaN"),
        (np.random.default_rng(0).normal(size=(VERTICES, 3, FRAMES)), "times as far apart"),
        (registrations()[:20], r"faces: found values in 0..299, expected whole numbers in 0..19"),
    ],
)
def test_arrays_that_cannot_be_used_are_refused_in_one_line(tmp_path, entry, said):
    data = write(tmp_path / "odd.hdf5", s=entry)
    assert re.search(said, refusal(lambda: load(data, "s")))


@pytest.mark.parametrize("faces", [np.zeros((0, 3), int), np.arange(12), np.full((4, 3), 1e9)])
def test_faces_that_cannot_be_used_are_refused(tmp_path, faces):
    data = write(tmp_path / "odd.hdf5", s=registrations(), faces=faces)
    assert "odd.hdf5: faces: found" in refusal(lambda: load(data, "s"))


def test_enormous_sizes_are_refused_by_what_the_file_declares(tmp_path):
    path = tmp_path / "huge.hdf5"
    with h5py.File(path, "w") as file:
        file.create_dataset("wide", (10**9, 3, 50), "f4", chunks=(1000, 3, 1))
        file.create_dataset("chunky", (300, 3, 10**8), "f4", chunks=(300, 3, 10**6))
    assert "ingest.max_points" in refusal(lambda: load(path, "wide"))
    assert "chunks of" in refusal(lambda: load(path, "chunky"))
    assert len({source.digest() for source in sources(path).values()}) == 2


def test_without_h5py_one_line_tells_how_to_get_it(data, monkeypatch):
    def missing(name):
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(dfaust.importlib, "import_module", missing)
    assert "pip install rearticulate[humans]" in refusal(lambda: sources(data))
