import numpy as np

from stages.kernels.points.nearest import KDTree, nearest, neighbours

POINTS = np.random.default_rng(0).normal(size=(100, 3))


def naive(a, b):
    return np.linalg.norm(a[:, None] - b[None], axis=-1)


def test_nearest_agrees_with_all_distances():
    queries = np.random.default_rng(1).normal(size=(50, 3))
    distance, index = nearest(KDTree(POINTS), queries)
    np.testing.assert_array_equal(index, naive(queries, POINTS).argmin(axis=1))
    np.testing.assert_allclose(distance, naive(queries, POINTS).min(axis=1))


def test_neighbours_are_the_nearest_others_in_order():
    distances, indices = neighbours(POINTS, 4)
    expected = np.sort(naive(POINTS, POINTS), axis=1)[:, 1:5]
    np.testing.assert_allclose(distances, expected, atol=1e-12)
    assert (indices != np.arange(100)[:, None]).all()


def test_neighbours_are_cut_to_what_there_is():
    assert neighbours(POINTS[:3], 8)[1].shape == (3, 2)
