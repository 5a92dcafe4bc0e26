import sys

import numpy as np
import pytest

from schemas.config import ExportConfig
from schemas.errors import InputError
from stages.export.geometry import cleaned, collision_meshes, fuse, part_mesh
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.surfaces.meshing import convex_hull


def input_frames(scene):
    return [scene.sequence.to_input(frame) for frame in scene.sequence.frames()]


def test_fused_frames_lie_on_the_canonical_surface_with_their_true_labels(two_part_object, fit_of):
    scene = two_part_object
    result = fit_of(scene, free=False)
    frames = input_frames(scene)
    cloud = fuse(result, frames, 3.0)
    p, labels = cloud.points, cloud.labels
    true = [
        np.einsum("nij,nj->ni", np.linalg.inv(result.T_frame_canonical[t])[scene.labels[t]][:, :3, :3], frame)
        + np.linalg.inv(result.T_frame_canonical[t])[scene.labels[t]][:, :3, 3]
        for t, frame in enumerate(frames)
    ]
    for part in (0, 1):
        surface = np.concatenate([q[own == part] for q, own in zip(true, scene.labels, strict=True)])
        assert nearest(KDTree(surface), p[labels == part])[0].max() < 1e-6
    assert len(p) > 0.95 * sum(map(len, frames))


def test_points_far_from_the_model_belong_to_no_part(hinge, fit_of):
    frames = input_frames(hinge)
    astray = [np.concatenate([frame, [[9.0, 9.0, 9.0]]]) for frame in frames]
    result = fit_of(hinge)
    assert len(fuse(result, astray, 3.0).points) == len(fuse(result, frames, 3.0).points)


def test_without_other_frames_the_cloud_is_the_canonical_one(hinge, fit_of):
    result = fit_of(hinge)
    cloud = fuse(result, None, 3.0)
    assert np.array_equal(cloud.points, result.canonical_points)
    assert np.array_equal(cloud.labels, result.labels)


def test_a_speck_apart_from_the_rest_is_dropped():
    rng = np.random.default_rng(0)
    sheet = np.column_stack([rng.uniform(size=(1500, 2)), np.zeros(1500)])
    speck = [5.0, 5.0, 5.0] + 0.02 * rng.normal(size=(12, 3))
    assert cleaned(np.concatenate([sheet, speck])).max() < 2.0


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_few_points_make_a_small_closed_mesh(count):
    mesh = part_mesh(np.random.default_rng(0).uniform(size=(count, 3)) * 0.01, 0.05, ExportConfig())
    assert mesh.closed
    assert np.ptp(mesh.vertices, axis=0).max() < 0.2


def test_the_hull_may_be_the_visible_mesh():
    cross = np.concatenate([np.linspace(-1, 1, 400)[:, None] * axis for axis in np.eye(3)])
    mesh = part_mesh(cross, 0.05, ExportConfig(surface="hull"))
    assert len(mesh.vertices) == len(convex_hull(mesh.vertices).vertices)


def test_coacd_that_is_not_there_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "coacd", None)
    with pytest.raises(InputError, match=r"collision coacd: found .* not installed; `pip install"):
        collision_meshes(convex_hull(np.eye(4, 3)), ExportConfig(collision="coacd"))
