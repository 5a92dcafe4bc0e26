import numpy as np
import pytest
from sklearn.metrics import adjusted_rand_score, rand_score

from stages.kernels.rand_index import adjusted_rand_index, rand_index


@pytest.mark.parametrize("seed", range(5))
def test_both_are_those_of_scikit_learn(seed):
    rng = np.random.default_rng(seed)
    a = rng.integers(0, 6, size=3000)
    b = np.where(rng.random(3000) < 0.2 * seed, rng.integers(3, 9, size=3000), a)
    assert adjusted_rand_index(a, b) == pytest.approx(adjusted_rand_score(a, b), abs=1e-15)
    assert rand_index(a, b) == pytest.approx(rand_score(a, b), abs=1e-15)


@pytest.mark.parametrize(
    ("a", "b"), [([0, 0, 0], [1, 1, 1]), ([0, 1, 2], [5, 3, 4]), ([0, 0, 0], [0, 1, 2]), ([7], [3]), ([0, 1], [0, 0])]
)
def test_degenerate_labellings(a, b):
    assert adjusted_rand_index(np.array(a), np.array(b)) == adjusted_rand_score(a, b)
    assert rand_index(np.array(a), np.array(b)) == rand_score(a, b)


def test_a_million_points_overflow_nothing():
    labels = np.arange(1_000_000) % 2
    assert adjusted_rand_index(labels, 1 - labels) == 1.0
    assert abs(adjusted_rand_index(labels, np.arange(1_000_000) // 500_000)) < 1e-5
