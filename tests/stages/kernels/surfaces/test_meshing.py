import numpy as np
import pytest

from stages.kernels.surfaces.meshing import (
    Mesh,
    closed_surface,
    contour,
    convex_hull,
    decimated,
    smoothed,
    without_outliers,
)


def sphere(count: int) -> np.ndarray:
    p = np.random.default_rng(0).normal(size=(count, 3))
    return p / np.linalg.norm(p, axis=1, keepdims=True)


def volume(mesh: Mesh) -> float:
    return float(np.linalg.det(mesh.vertices[mesh.triangles]).sum() / 6)


def test_a_field_is_contoured_where_it_is_zero_with_triangles_that_face_outwards():
    grid = np.stack(np.meshgrid(*[np.linspace(-1.5, 1.5, 31)] * 3, indexing="ij"), axis=-1)
    mesh = contour(1.0 - np.linalg.norm(grid, axis=-1), np.full(3, -1.5), 0.1)
    assert mesh.closed
    assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(1.0, abs=0.005)
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi, rel=0.01)


def test_bodies_that_touch_at_an_edge_are_closed_each():
    field = -np.ones((5, 5, 5))
    field[1, 1, 2] = field[2, 2, 2] = 1.0
    assert contour(field, np.zeros(3), 1.0).closed


def test_a_field_without_zeros_has_no_surface():
    assert len(contour(-np.ones((4, 4, 4)), np.zeros(3), 1.0).triangles) == 0


def test_what_points_enclose_is_solid():
    radius = 0.15
    mesh = closed_surface(sphere(3000), radius)
    assert mesh.closed
    distance = np.linalg.norm(mesh.vertices, axis=1)
    assert 1.0 < distance.mean() < 1.0 + radius / 2
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi * distance.mean() ** 3, rel=0.02)


def test_an_open_sheet_becomes_a_thin_closed_slab():
    sheet = np.random.default_rng(0).uniform(size=(2000, 3)) * [1.0, 1.0, 0.0]
    mesh = closed_surface(sheet, 0.09)
    assert mesh.closed
    assert 0.02 < np.abs(mesh.vertices[:, 2]).max() < 0.045


def test_a_lone_point_becomes_a_little_ball():
    mesh = closed_surface(np.array([[5.0, 0.0, 0.0]]), 0.1)
    assert mesh.closed
    assert np.linalg.norm(mesh.vertices - [5.0, 0.0, 0.0], axis=1).max() < 0.1


def test_decimation_keeps_a_closed_mesh_closed_and_its_volume():
    mesh = closed_surface(sphere(3000), 0.15)
    coarse = decimated(mesh, 500)
    assert len(coarse.triangles) <= 1000
    assert coarse.closed
    assert volume(coarse) == pytest.approx(volume(mesh), rel=0.05)


def test_a_mesh_with_a_hole_or_a_turned_triangle_is_not_closed():
    hull = convex_hull(sphere(50))
    turned = hull.triangles.copy()
    turned[0] = turned[0, ::-1]
    assert hull.closed
    assert not Mesh(hull.vertices, hull.triangles[1:]).closed
    assert not Mesh(hull.vertices, turned).closed


def test_a_convex_hull_faces_outwards():
    cube = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T.astype(float)
    assert volume(convex_hull(np.concatenate([cube, cube * 0.5 + 0.2]))) == pytest.approx(1.0)


def test_a_point_far_from_all_others_is_an_outlier():
    kept = without_outliers(np.concatenate([sphere(500), [[3.0, 0.0, 0.0]]]))
    assert not kept[-1]
    assert kept[:-1].mean() > 0.98


def test_smoothing_evens_out_noise_across_a_surface():
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.uniform(size=(1000, 2)), 0.005 * rng.normal(size=1000)])
    assert smoothed(flat)[:, 2].std() < 0.6 * flat[:, 2].std()
