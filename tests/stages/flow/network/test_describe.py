import numpy as np
from scipy.spatial.transform import Rotation

from schemas.config import FlowConfig
from stages.flow.match import Described, match_features
from stages.flow.network.describe import describe
from stages.flow.stage import compute_flow


def lamp(rng, turn):
    """A thing that looks the same from nowhere: a board, a post on it, and an arm that turns about the post's end."""
    board = rng.uniform([-0.25, -0.15, 0], [0.25, 0.15, 0.02], (900, 3))
    post = np.array([-0.15, 0, 0]) + rng.uniform([-0.02, -0.02, 0], [0.02, 0.02, 0.45], (500, 3))
    arm = rng.uniform([0, -0.03, -0.01], [0.35, 0.03, 0.01], (500, 3))
    arm[:, 1] *= 0.5 + 2 * arm[:, 0]
    R = Rotation.from_rotvec([0, turn, 0]).as_matrix()
    return np.concatenate([board, post, arm @ R.T + [-0.15, 0, 0.45]]), np.concatenate([board, post, arm])


def test_the_shipped_network_finds_most_points_again_after_a_large_motion():
    rng = np.random.default_rng(0)
    (before, rest_before), (after, rest_after) = lamp(rng, 0.1), lamp(rng, 0.9)
    config = FlowConfig()
    matches = match_features(Described(before, describe(before, config)), Described(after, describe(after, config)))
    off = np.linalg.norm(rest_before[matches.source_index] - rest_after[matches.target_index], axis=1)
    assert len(off) > 0.3 * len(before)
    right = off < 0.04
    assert right.mean() > 0.6
    assert matches.confidence[right].mean() > matches.confidence[~right].mean()


def test_the_estimator_network_says_where_matched_points_went(hinge):
    flow = compute_flow(hinge.sequence, FlowConfig(estimator="network"), np.random.default_rng(0))
    frames = hinge.sequence.frames()
    assert (flow.match_counts > 20).all()
    for pair in flow.pairs():
        source, target = frames[pair.source_frame], frames[pair.target_frame]
        np.testing.assert_allclose(source[pair.source_index] + pair.flow, target[pair.target_index])
        assert ((pair.confidence > 0) & (pair.confidence <= 1)).all()
