import numpy as np
import pytest

from stages.flow.match import CHUNK, Described, keep_distances, match_features


def described(rng, rows, features=8):
    return Described(rng.uniform(size=(rows, 3)), 3 * rng.normal(size=(rows, features)))


def test_matches_and_confidences_are_those_of_a_naive_search():
    rng = np.random.default_rng(0)
    source, target = described(rng, CHUNK + 300), described(rng, CHUNK + 100)
    target.p[:50] = target.p[50:100] + 0.004  # some at one place
    S = np.exp(source.features @ target.features.T)
    S /= S.sum(axis=1, keepdims=True)
    back = (source.features @ target.features.T).argmax(axis=0)
    expected, confidence = [], []
    for i, j in enumerate(S.argmax(axis=1)):
        if np.linalg.norm(source.p[back[j]] - source.p[i]) <= source.same_place:
            expected.append((i, j))
            confidence.append(S[i, np.linalg.norm(target.p - target.p[j], axis=1) < target.same_place].sum())
    matches = match_features(source, target)
    assert list(zip(matches.source_index, matches.target_index, strict=True)) == expected
    np.testing.assert_allclose(matches.confidence, confidence, rtol=1e-6)


def test_a_way_back_to_the_same_place_is_enough():
    p = np.array([[0.0, 0, 0], [0.01, 0, 0], [1.0, 0, 0], [1.01, 0, 0]])
    source = Described(p, 5 * np.array([[1.0, 0], [1.1, 0], [0, 1.0], [-1, 0.5]]))
    target = Described(p[[0, 2]], 5 * np.eye(2))
    np.testing.assert_array_equal(match_features(source, target).source_index, [0, 1, 2, 3])
    apart = Described(p[[0, 2, 1, 3]], source.features)
    np.testing.assert_array_equal(match_features(apart, target).source_index, [1, 2])


def test_what_looks_like_something_else_is_matched_with_less_confidence():
    p = np.eye(4)[:, :3]
    source = Described(p[:2], 4 * np.array([[1.0, 0, 0, 0], [0, 0.8, 0.6, 0]]))
    matches = match_features(source, Described(p, 4 * np.eye(4)))
    np.testing.assert_array_equal(matches.target_index, [0, 1])
    assert 1 >= matches.confidence[0] > matches.confidence[1] > 0


@pytest.mark.parametrize(("points", "targets"), [(0, 3), (3, 0), (0, 0), (1, 1), (1, 40)])
def test_clouds_of_hardly_a_point_have_at_most_one_match(points, targets):
    rng = np.random.default_rng(0)
    matches = match_features(described(rng, points), described(rng, targets))
    assert len(matches.source_index) == min(points, targets, 1)


def test_a_match_that_leaves_its_company_is_dropped():
    rng = np.random.default_rng(0)
    p = rng.uniform(size=(300, 3)) * [1, 0.2, 0.1]
    T = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    moved = p @ T + [0.2, 0.1, 0.5] + rng.normal(scale=0.002, size=p.shape)
    wrong = rng.permutation(300)[:60]
    moved[wrong] += rng.choice([-0.3, 0.3], (60, 3))
    kept = keep_distances(p, moved, 0.01)
    assert not kept[wrong].any()
    assert np.delete(kept, wrong).mean() > 0.95
    assert len(keep_distances(p[:0], p[:0], 0.01)) == 0
