import numpy as np
import pytest

from stages.flow.match import mutual_nearest


def unit(rng, rows, features):
    f = rng.normal(size=(rows, features))
    return f / np.linalg.norm(f, axis=1, keepdims=True)


def test_matches_are_those_of_a_naive_search():
    rng = np.random.default_rng(0)
    source, target = unit(rng, 1500, 8), unit(rng, 1300, 8)
    scores = source @ target.T
    forward, backward = scores.argmax(axis=1), scores.argmax(axis=0)
    expected = [(i, j) for i, j in enumerate(forward) if backward[j] == i]
    matches = mutual_nearest(source, target)
    assert list(zip(matches.source_index, matches.target_index, strict=True)) == expected
    assert ((matches.confidence >= 0) & (matches.confidence <= 1)).all()


def test_a_cloud_in_another_order_is_matched_whole():
    rng = np.random.default_rng(1)
    features, order = unit(rng, 50, 6), rng.permutation(50)
    matches = mutual_nearest(features, features[order])
    np.testing.assert_array_equal(order[matches.target_index], np.arange(50))


def test_what_looks_like_something_else_is_matched_with_less_confidence():
    target = np.eye(4)
    source = np.array([[1.0, 0, 0, 0], [0, 0.8, 0.6, 0]])
    matches = mutual_nearest(source, target)
    np.testing.assert_array_equal(matches.target_index, [0, 1])
    assert matches.confidence[0] > matches.confidence[1]


@pytest.mark.parametrize(("points", "targets"), [(0, 3), (3, 0), (0, 0), (1, 1)])
def test_clouds_of_hardly_a_point_have_at_most_one_match(points, targets):
    assert len(mutual_nearest(np.ones((points, 2)), np.ones((targets, 2))).source_index) == min(points, targets, 1)
