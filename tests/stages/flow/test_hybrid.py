import numpy as np
import pytest

from schemas.config import FlowConfig, GeometricFlowConfig
from stages.flow.geometric import REACH_FINE, FramePair, align, estimate_geometric
from stages.flow.hybrid import better_motion, hybrid_of
from stages.flow.match import Matches
from stages.flow.pair import PairFlow
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.support.progress import silent

GEOMETRIC = GeometricFlowConfig(points=400, nodes=80, iterations=4)
CONFIG = FlowConfig(geometric=GEOMETRIC)
T_FAR = np.array([[-1.0, 0, 0, 0.9], [0, -1, 0, 0.1], [0, 0, 1, 0.3], [0, 0, 0, 1]])  # half a turn


def estimate(estimator, frames):
    return estimator(frames, CONFIG, np.random.default_rng(0), silent)


def assert_same(pairs: list[PairFlow], expected: list[PairFlow]) -> None:
    for pair, other in zip(pairs, expected, strict=True):
        for name in ("source_index", "target_index", "flow", "confidence"):
            np.testing.assert_array_equal(getattr(pair, name), getattr(other, name))


@pytest.fixture
def folded(hinge):
    """Two frames with the lid turned by half a turn between them, and where the first one's points went."""
    before, after = hinge.sequence.frames()[1:3]
    p_next, p_after = (
        np.where(labels[:, None] == 1, move_points(T_FAR, p), p)
        for labels, p in zip(hinge.labels[1:3], (before, after), strict=True)
    )
    return before, p_after, p_next


def matches(folded, share_right):
    """The true place of every point in the second frame, most of them replaced by random ones."""
    _, after, p_next = folded
    rng = np.random.default_rng(0)
    target = nearest(KDTree(after), p_next)[1]
    wrong = rng.uniform(size=len(target)) > share_right
    target[wrong] = rng.integers(len(after), size=wrong.sum())
    return target


def error(pair, folded):
    return np.linalg.norm(pair.flow + folded[0][pair.source_index] - folded[2][pair.source_index], axis=1).mean()


def test_it_is_geometric_where_nothing_looks_alike(hinge, monkeypatch):
    nothing = Matches(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
    monkeypatch.setattr("stages.flow.hybrid.match_features", lambda source, target: nothing)
    frames = hinge.sequence.frames()[:3]
    assert_same(
        estimate(hybrid_of(lambda points, config: np.zeros((len(points), 4))), frames),
        estimate(estimate_geometric, frames),
    )


def test_an_alignment_that_leaves_only_noise_is_not_described(hinge):
    def describe(points, config):
        raise AssertionError("described")

    frame = hinge.sequence.frames()[0]
    assert_same(estimate(hybrid_of(describe), [frame, frame]), estimate(estimate_geometric, [frame, frame]))


def test_matches_that_are_mostly_wrong_lead_over_a_motion_too_far_for_geometry(folded):
    before, after, _ = folded
    pair = FramePair.of(before, after, GEOMETRIC)
    Ts = align(pair, GEOMETRIC, None).Ts
    target = matches(folded, 0.4)
    found = better_motion(pair, Ts, before, after[target], GEOMETRIC, np.random.default_rng(0))
    assert pair.fine.cost(found, REACH_FINE) < pair.fine.cost(Ts, REACH_FINE)
    assert error(pair.flow(found, 2.0), folded) < 0.3 * error(pair.flow(Ts, 2.0), folded)


def test_matches_that_lead_astray_change_nothing(folded):
    before, after, _ = folded
    pair = FramePair.of(before, after, GEOMETRIC)
    Ts = align(pair, GEOMETRIC, None).Ts
    collapsed = np.repeat(after[:1], len(before), axis=0)
    assert better_motion(pair, Ts, before, collapsed, GEOMETRIC, np.random.default_rng(0)) is Ts


def test_the_descriptor_is_asked_for_each_frame_once_and_believed(folded):
    before, after, _ = folded
    rng = np.random.default_rng(1)
    codes = rng.normal(size=(len(before), 16))
    codes *= 5 / np.linalg.norm(codes, axis=1, keepdims=True)
    features = {before[0, 0]: codes, after[0, 0]: rng.normal(size=(len(after), 16)) / 16}
    features[after[0, 0]][matches(folded, 1.0)] = codes
    asked = []

    def describe(points, config):
        asked.append(points[0, 0])
        return features[points[0, 0]]

    pairs = estimate(hybrid_of(describe), [before, after, before])
    assert error(pairs[0], folded) < 0.05
    assert asked == [before[0, 0], after[0, 0], before[0, 0]]
