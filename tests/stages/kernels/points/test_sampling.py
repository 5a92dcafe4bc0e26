import numpy as np

from stages.kernels.points.sampling import THINNING, farthest_points, normals, point_spacing, thinned, working_points

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
    assert point_spacing(grid) == 0.25
    assert point_spacing(np.repeat(grid, 3, axis=0)) == 0.25


def test_normals_of_a_sphere_point_outwards_or_inwards():
    sphere = RNG.normal(size=(3000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    assert np.median(np.abs((normals(sphere) * sphere).sum(axis=1))) > 0.99


def test_duplicates_of_chosen_points_are_not_chosen():
    points = np.repeat(np.eye(3), 5, axis=0)
    assert len(farthest_points(points, 10)) == 3


def test_working_points_of_a_large_cloud_are_spread_and_always_the_same():
    rng = np.random.default_rng(1)
    cloud = rng.uniform(size=(20 * THINNING, 3))
    cloud[: len(cloud) // 2] *= 0.1  # dense in a corner
    chosen = working_points(cloud, 10)
    np.testing.assert_array_equal(chosen, working_points(cloud, 10))
    assert len(np.unique(chosen)) == 10
    at_random = [rng.choice(len(cloud), 10, replace=False) for _ in range(50)]

    def widest_gap(indices):
        return np.linalg.norm(cloud[:, None] - cloud[indices][None], axis=-1).min(axis=1).max()

    assert widest_gap(chosen) < 0.8 * np.median([widest_gap(indices) for indices in at_random])


def test_working_points_of_a_cloud_that_need_not_be_thinned_are_the_farthest():
    cloud = RNG.normal(size=(THINNING * 10, 3))
    np.testing.assert_array_equal(working_points(cloud, 10), farthest_points(cloud, 10))
    np.testing.assert_array_equal(working_points(cloud[:7], 10), np.arange(7))


def test_thinned_keeps_all_or_an_even_choice_in_order():
    assert thinned(5, 5).tolist() == [0, 1, 2, 3, 4]
    chosen = thinned(1000, 100)
    assert len(set(chosen.tolist())) == 100
    assert (np.diff(chosen) > 0).all()
    assert 400 < chosen.mean() < 600
