import numpy as np

from stages.kernels.sampling import farthest_points, normals, spacing

RNG = np.random.default_rng(0)


def test_each_farthest_point_is_farthest_from_those_before():
    points = RNG.normal(size=(200, 3))
    chosen = farthest_points(points, 20)
    assert chosen[0] == 0
    for k in range(1, 20):
        to_chosen = np.linalg.norm(points[:, None] - points[chosen[:k]][None], axis=-1).min(axis=1)
        assert to_chosen[chosen[k]] == to_chosen.max()


def test_all_points_are_taken_when_there_are_too_few():
    np.testing.assert_array_equal(farthest_points(RNG.normal(size=(5, 3)), 9), np.arange(5))


def test_spacing_of_a_grid_is_its_step():
    grid = np.stack(np.meshgrid(*[np.arange(5) * 0.25] * 3), axis=-1).reshape(-1, 3)
    assert spacing(grid) == 0.25
    assert spacing(np.repeat(grid, 3, axis=0)) == 0.25


def test_normals_of_a_sphere_point_outwards_or_inwards():
    sphere = RNG.normal(size=(3000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    assert np.median(np.abs((normals(sphere) * sphere).sum(axis=1))) > 0.99


def test_duplicates_of_chosen_points_are_not_chosen():
    points = np.repeat(np.eye(3), 5, axis=0)
    assert len(farthest_points(points, 10)) == 3
