from __future__ import annotations

import numpy as np
import pytest
import trimesh

from stages.ingest.roboart.sensor import draw_viewpoints, posed_triangles, sample_posed, sample_visible
from stages.ingest.roboart.surface import Surface


def surface_of(*meshes):
    pieces = [np.asarray(mesh.triangles) for mesh in meshes]
    return Surface(np.concatenate(pieces), np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces]))


def standing(*offsets):
    Ts = np.tile(np.eye(4), (len(offsets), 1, 1))
    Ts[:, :3, 3] = offsets
    return Ts


BALL = trimesh.creation.icosphere(subdivisions=4)
WALL = trimesh.creation.box([0.1, 6, 6])


def test_a_ball_is_seen_up_to_its_horizon():
    viewpoint = np.array([[3.0, 0.0, 0.0]])
    points, labels = sample_visible(surface_of(BALL), standing([0, 0, 0]), viewpoint, 2000, np.random.default_rng(0))
    assert points.shape == (2000, 3)
    assert labels.tolist() == [0] * 2000
    assert points[:, 0].min() == pytest.approx(1 / 3, abs=0.03)  # tangents from a distance of 3 touch there
    # slices of a sphere of one height have one area (Archimedes)
    assert points[:, 0].mean() == pytest.approx(2 / 3, abs=0.02)


def test_what_stands_behind_a_wall_is_seen_from_the_other_side_only():
    surface, Ts = surface_of(BALL, WALL), standing([-2, 0, 0], [0, 0, 0])
    front, back = np.array([[5.0, 0, 0]]), np.array([[-5.0, 0, 0]])
    rng = np.random.default_rng(0)
    labels = {name: sample_visible(surface, Ts, views, 500, rng)[1] for name, views in {"+": front, "-": back}.items()}
    assert set(labels["+"]) == {1}
    assert set(labels["-"]) == {0, 1}
    both, parts = sample_visible(surface, Ts, np.concatenate([front, back]), 500, rng)
    assert (both[parts == 1, 0] > 0).any()
    assert (both[parts == 1, 0] < 0).any()
    assert set(parts) == {0, 1}


def test_visible_points_lie_on_the_posed_surface():
    Ts = standing([4, 5, 6])
    points, _ = sample_visible(surface_of(WALL), Ts, np.array([[9.0, 5, 6]]), 300, np.random.default_rng(0))
    np.testing.assert_allclose(points[:, 0], 4.05, atol=1e-12)
    assert np.abs(points[:, 1:] - [5, 6]).max() <= 3


def test_points_and_triangles_move_with_their_part():
    surface, Ts = surface_of(BALL, WALL), standing([10, 0, 0], [-10, 0, 0])
    points, labels = sample_posed(surface, Ts, 1000, np.random.default_rng(0))
    assert (np.sign(points[:, 0]) == np.where(labels == 0, 1, -1)).all()
    x = posed_triangles(surface, Ts)[..., 0]
    assert (np.where(surface.part == 0, 1, -1) == np.sign(x).T).all()


@pytest.mark.parametrize("count", [1, 3])
def test_viewpoints_stand_around_the_object_level_with_it_or_above(count):
    centre = np.array([1.0, 2.0, 3.0])
    for seed in range(20):
        away = draw_viewpoints(count, centre, 2.0, np.random.default_rng(seed)) - centre
        np.testing.assert_allclose(np.linalg.norm(away, axis=1), 3.0)
        assert (away[:, 2] >= 0).all()
        angles = np.sort(np.arctan2(away[:, 1], away[:, 0]))
        np.testing.assert_allclose(np.diff(angles), 2 * np.pi / count)
