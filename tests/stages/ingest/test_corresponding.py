from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.config import IngestConfig
from schemas.errors import InputError
from schemas.sequence import IngestedSequence
from stages.evaluation.true_motion import true_positions
from stages.ingest.file_source import file_source

FRAMES = 4


def grid() -> tuple[np.ndarray, np.ndarray]:
    """A sheet of 20 x 20 vertices, and its triangles."""
    x, y = np.meshgrid(np.linspace(0, 2, 20), np.linspace(0, 1, 20), indexing="ij")
    corner = np.arange(400).reshape(20, 20)
    a, b, c, d = (corner[i : i + 19, j : j + 19].ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3), np.concatenate(
        [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]
    )


def bent(frames: int = FRAMES) -> np.ndarray:
    """The sheet, which bends: nothing of it is rigid."""
    p = grid()[0]
    return np.stack([p + np.outer(0.1 * t * p[:, 0] ** 2, [0, 0, 1]) for t in range(frames)])


def config(**settings) -> IngestConfig:
    return IngestConfig(correspond=True, registrations={"points": 150} | settings.pop("registrations", {}), **settings)


def load(path: Path, settings: IngestConfig | None = None) -> IngestedSequence:
    return file_source(path).load(settings or config(), np.random.default_rng(0))


def npz(folder: Path, frames: object, **arrays: np.ndarray) -> Path:
    path = folder / "sheet.npz"
    named = {"points": frames} if isinstance(frames, np.ndarray) else {f"frame_{i}": f for i, f in enumerate(frames)}
    np.savez(path, **named, **arrays)
    return path


def ply(folder: Path, frames: np.ndarray, triangles: np.ndarray | None) -> Path:
    for index, points in enumerate(frames):
        lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property double {c}" for c in "xyz")]
        lines += (
            [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
            if triangles is not None
            else []
        )
        rows = [" ".join(map(repr, row)) for row in points.tolist()]
        rows += [f"3 {a} {b} {c}" for a, b, c in triangles.tolist()] if triangles is not None else []
        (folder / f"frame_{index}.ply").write_text("\n".join([*lines, "end_header", *rows, ""]))
    return folder


def check(ingested: IngestedSequence, on_vertices: bool) -> None:
    """Frames have points of their own, and the truth leads each along the bending sheet."""
    sequence = ingested.sequence
    frames = [sequence.to_input(points) for points in sequence.frames()]
    assert [len(points) for points in frames] == [150] * FRAMES
    assert not np.allclose(frames[0][:, :2], frames[1][:, :2])
    assert np.isclose(frames[0][:, None], grid()[0]).all(axis=2).any(axis=1).all() == on_vertices
    p_true = true_positions(ingested, 1)
    assert p_true is not None
    for t, points in enumerate(sequence.to_input(p_true)):
        np.testing.assert_allclose(points[:, :2], frames[1][:, :2], atol=1e-9)
        np.testing.assert_allclose(
            points[:, 2], 0.1 * t * frames[1][:, 0] ** 2, atol=0 if on_vertices else 0.01, rtol=1e-9
        )
    assert ingested.truth is None


def test_an_npz_is_sampled_from_its_faces_or_else_its_points(tmp_path):
    check(load(npz(tmp_path, bent(), faces=grid()[1])), on_vertices=False)
    check(load(npz(tmp_path, bent())), on_vertices=True)
    check(load(npz(tmp_path, list(bent()))), on_vertices=True)


def test_a_folder_of_ply_is_sampled_from_its_faces_or_else_its_points(tmp_path):
    check(load(ply(tmp_path, bent(), grid()[1])), on_vertices=False)
    check(load(ply(tmp_path, bent(), None)), on_vertices=True)


def test_no_more_points_are_drawn_than_there_are(tmp_path):
    ingested = load(npz(tmp_path, bent()), config(registrations={"points": 1000}))
    assert ingested.sequence.point_counts.tolist() == [400] * FRAMES


def test_frames_are_chosen_by_first_every_and_frames(tmp_path):
    path = npz(tmp_path, bent(20))
    ingested = load(path, config(every=3, registrations={"first": 2, "frames": 4}))
    assert ingested.sequence.frame_names == tuple(f"sheet.npz[{index}]" for index in (2, 5, 8, 11))
    with pytest.raises(InputError, match=r"20 frames.*leave 1.*ingest.registrations.first \(19\)"):
        load(path, config(registrations={"first": 19}))


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        ([*bent(3), bent()[0][:399]], r"400 points in .*frame_0.* and 399 in .*frame_3.*as many in every frame"),
        (np.stack([np.random.default_rng(t).permutation(p) for t, p in enumerate(bent())]), "times as far apart"),
        (np.where(np.arange(FRAMES)[:, None, None] == 2, np.nan, bent()), r"\[2\].*NaN.*400 points"),
    ],
)
def test_points_that_do_not_correspond_are_refused_in_one_line(tmp_path, frames, said):
    with pytest.raises(InputError, match=said) as caught:
        load(npz(tmp_path, frames))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "faces", [np.array([[0, 1, 400]]), np.array([[0, 1]]), np.array([[0.5, 1, 2]]), np.array([[-1, 1, 2]])]
)
def test_faces_that_do_not_fit_are_refused(tmp_path, faces):
    with pytest.raises(InputError, match=r"sheet.npz: faces: found"):
        load(npz(tmp_path, bent(), faces=faces))


def test_a_body_that_turns_far_corresponds(tmp_path):
    turned = np.stack([Rotation.from_rotvec([0, 0, t]).apply(p) for t, p in enumerate(bent())])
    assert load(npz(tmp_path, turned)).surface is not None


def test_a_truth_beside_is_left_out_with_a_word(tmp_path, caplog):
    np.savez(
        tmp_path / "ground_truth.npz", labels=np.zeros((FRAMES, 400), int), poses=np.tile(np.eye(4), (FRAMES, 1, 1, 1))
    )
    ply(tmp_path, bent(), None)
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        assert load(tmp_path).truth is None
    assert "ground_truth.npz" in caplog.text


def test_without_the_setting_frames_are_taken_as_they_are(tmp_path):
    ingested = load(npz(tmp_path, bent(), faces=grid()[1]), IngestConfig())
    assert ingested.surface is None
    assert ingested.sequence.point_counts.tolist() == [400] * FRAMES
