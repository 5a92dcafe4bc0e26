from __future__ import annotations

import numpy as np
import pytest
import trimesh

from schemas.config import DepthConfig
from schemas.sequence import NO_PART
from stages.ingest.roboart.depth_camera import DepthSensor, behind_edges, pixel_rays, quantised, scan_depth
from stages.ingest.roboart.surface import Surface

PERFECT = DepthConfig(cameras=1, width=80, height=60, quantisation_percent=0, flying_share=0)
MANY = 10**6


def surface_of(*meshes):
    pieces = [np.asarray(mesh.triangles) for mesh in meshes]
    return Surface(np.concatenate(pieces), np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces]))


def wall(x, half=4.0):
    return trimesh.creation.box(
        [0.1, 2 * half, 2 * half], np.array([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    )


def scanned(surface, config=PERFECT, noise=0.0, eye=(5.0, 0.0, 0.0), count=MANY):
    Ts = np.tile(np.eye(4), (surface.part.max() + 1, 1, 1))
    sensor = DepthSensor(config, np.zeros(3), 2.0, noise)
    return scan_depth(surface, Ts, np.array([eye]), sensor, count, np.random.default_rng(0))


def test_rays_of_pixels_span_the_field_of_view_and_advance_by_one_along_the_line_of_sight():
    config = DepthConfig(width=64, height=32, field_of_view_degrees=90)
    rays = pixel_rays(np.array([0.0, -3, 0]), np.zeros(3), config)
    assert rays.shape == (32, 64, 3)
    np.testing.assert_allclose(rays[..., 1], 1)
    np.testing.assert_allclose(rays[0, 0], [-63 / 64, 1, 31 / 64])  # the first row is the highest, from the left
    np.testing.assert_allclose(rays.mean(axis=(0, 1)), [0, 1, 0], atol=1e-12)


def test_perfect_pixels_lie_on_the_first_surface_that_they_meet():
    points, labels = scanned(surface_of(wall(-1.0), wall(2.0, half=0.5)))
    np.testing.assert_allclose(points[labels == 0, 0], -0.95, atol=1e-5)
    np.testing.assert_allclose(points[labels == 1, 0], 2.05, atol=1e-5)
    shadow = 0.5 * (5 + 0.95) / (5 - 2.05)
    assert np.abs(points[labels == 0, 1:]).max(axis=1).min() > shadow
    assert np.abs(points[labels == 1, 1:]).max() <= 0.5


def test_noise_grows_with_the_square_of_the_depth():
    near, far = (scanned(surface_of(wall(x)), noise=0.02)[0][:, 0] - x - 0.05 for x in (0.0, -5.0))
    assert near.std() == pytest.approx(0.02, rel=0.1)
    assert far.std() == pytest.approx(0.08, rel=0.1)


def test_steps_of_depth_grow_with_its_square_and_are_as_stated_at_the_usual_depth():
    for depth, step in ((3.0, 0.01), (6.0, 0.04)):
        levels = np.unique(quantised(np.linspace(depth - 0.2, depth + 0.2, 5000), 0.01, 3.0))
        assert np.diff(levels).mean() == pytest.approx(step, rel=0.05)
    np.testing.assert_array_equal(quantised(np.array([1.0, 2.0]), 0.0, 3.0), [1.0, 2.0])


def test_only_pixels_at_edges_fly_and_they_lie_behind_their_edge_and_belong_to_no_part():
    surface = surface_of(wall(-1.0), wall(2.0, half=0.5))
    flying = PERFECT.model_copy(update={"flying_share": 1.0})
    points, labels = scanned(surface, flying)
    stray = points[labels == NO_PART]
    of_pane = stray[stray[:, 0] > 1]
    assert 40 < len(of_pane) < 200
    assert of_pane[:, 0].max() <= 2.05 + 1e-5
    assert of_pane[:, 0].min() > 2.05 - 0.1 * 2.0 - 1e-5
    assert np.abs(of_pane[:, 1:]).max(axis=1).min() > 0.4
    few = scanned(surface, PERFECT.model_copy(update={"flying_share": 0.3}))[1]
    assert 0.2 < (few == NO_PART).sum() / len(stray) < 0.4
    assert (scanned(surface)[1] == NO_PART).sum() == 0


def test_edges_are_where_a_neighbour_is_much_farther_or_nothing():
    depth = np.array([[1.0, 1.01, 1.5, np.inf]])
    np.testing.assert_allclose(behind_edges(depth, 1.0), [[0, 0.1, 0.1, 0]])
    np.testing.assert_allclose(behind_edges(depth, 10.0), [[0, 0.49, 1.0, 0]])


def test_surfaces_turned_far_from_the_camera_return_nothing():
    floor = trimesh.creation.box([40, 4, 0.1])
    steep = PERFECT.model_copy(update={"grazing_degrees": 75.0})
    eye = (5.0, 0.0, 1.05)  # a metre above the floor, which it sees at 75 degrees where it is 3.7 m away
    points, whole = scanned(surface_of(floor), steep, eye=eye)[0], scanned(surface_of(floor), eye=eye)[0]
    far = np.linalg.norm(points[:, :2] - eye[:2], axis=1).max()
    assert far == pytest.approx(np.tan(np.radians(75)), rel=0.05)
    assert np.linalg.norm(whole[:, :2] - eye[:2], axis=1).max() > far + 0.5


def test_of_too_many_pixels_a_random_choice_remains_and_two_cameras_see_both_sides():
    surface, Ts = surface_of(wall(0.0)), np.eye(4)[None]
    sensor, eyes = DepthSensor(PERFECT, np.zeros(3), 2.0, 0.0), np.array([[5.0, 0, 0], [-5.0, 0, 0]])
    points, labels = scan_depth(surface, Ts, eyes, sensor, 1000, np.random.default_rng(0))
    assert points.shape == (1000, 3)
    assert labels.tolist() == [0] * 1000
    assert 0.4 < (points[:, 0] > 0).mean() < 0.6
