"""The page and the picture of an object whose coordinates count from far away."""

import io

import numpy as np
import pytest
from matplotlib.image import imread

from schemas.config import ExportConfig
from schemas.sequence import IngestedSequence
from stages.export.stage import compute_export
from stages.report.figure import draw
from stages.report.scene import part_meshes, scene_data
from stages.report.stage import compute_report
from stages.support.pictures import picture_bytes


@pytest.fixture
def seen(near_and_far):
    """Near and far: the fit, its sequence and the sequence's frames."""
    return [
        (result, scene.sequence, [scene.sequence.to_input(frame) for frame in scene.sequence.frames()])
        for scene, result in near_and_far
    ]


def test_the_view_shows_the_same_scene_about_another_centre(seen, away):
    near, far = (scene_data(result, frames) for result, _, frames in seen)
    np.testing.assert_allclose(np.subtract(far["centre"], near["centre"]), away, rtol=0, atol=1e-7)
    assert far["half"] == pytest.approx(near["half"], abs=1e-7)
    for joint, other in zip(far["joints"], near["joints"], strict=True):
        for name in ("point", "place"):
            np.testing.assert_allclose(
                np.subtract(joint[name], far["centre"]), other[name] - np.array(near["centre"]), atol=1e-3
            )
    for T, other in zip(far["T_frame_root"], near["T_frame_root"], strict=True):
        T, other = np.reshape(T, (3, 4)), np.reshape(other, (3, 4))
        moved, expected = (R[:, :3] @ c + R[:, 3] - c for R, c in ((T, far["centre"]), (other, near["centre"])))
        np.testing.assert_allclose(moved, expected, atol=1e-6)


def test_what_is_left_of_the_frames_is_told_alike(seen):
    near, far = (compute_report(result, sequence) for result, sequence, _ in seen)
    np.testing.assert_allclose(far.residuals, near.residuals, atol=1e-4)
    assert far.sampling == pytest.approx(near.sampling, abs=1e-4)


def test_meshes_lie_where_the_points_do(seen, monkeypatch):
    result, _, frames = seen[1]
    robot = compute_export(result, frames, ExportConfig(triangles=400), "box")
    for most in (10_000, 400):  # as they are, and made coarser
        monkeypatch.setattr("stages.report.scene.MOST_TRIANGLES", most)
        for part, mesh in enumerate(part_meshes(robot)):
            own = result.canonical_points[result.labels == part]
            bounds = [own.min(axis=0), own.max(axis=0)]
            np.testing.assert_allclose([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)], bounds, atol=0.06)


def test_the_picture_looks_alike(seen):
    near, far = (
        imread(io.BytesIO(picture_bytes(draw(result, IngestedSequence(sequence=sequence)), "png", dpi=30)))
        for result, sequence, _ in seen
    )
    assert near.shape == far.shape
    assert np.abs(near - far).mean() < 0.01
