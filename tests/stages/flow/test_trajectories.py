import numpy as np

from stages.flow.trajectories import follow_flow, interpolate
from stages.kernels.points.nearest import KDTree


def test_interpolation_is_exact_at_samples_and_an_average_between():
    tree = KDTree(np.array([[0.0, 0, 0], [2.0, 0, 0]]))
    values, distance = interpolate(tree, np.array([[1.0], [3.0]]), np.array([[0.0, 0, 0], [1.0, 0, 0]]), 3)
    np.testing.assert_allclose(values[:, 0], [1, 2], atol=1e-6)
    np.testing.assert_allclose(distance, [0, 1])


def test_true_flow_carries_points_to_their_true_place(two_part_object):
    truth = two_part_object
    p_canonical = truth.sequence.frames()[2]
    followed = follow_flow(p_canonical, truth.sequence, truth.true_flow(), 2, 1)
    Ts = truth.Ts_frame_canonical[:, truth.canonical_labels]
    true = np.einsum("tnij,nj->tni", Ts[..., :3, :3], p_canonical) + Ts[..., :3, 3]
    np.testing.assert_array_equal(followed[2], p_canonical)
    assert np.linalg.norm(followed - true, axis=-1).mean() < 0.01


def test_points_stand_still_where_a_pair_has_no_matches(hinge):
    flow = hinge.true_flow()
    counts = flow.match_counts.copy()
    first, counts[0] = counts[0], 0
    known = flow.replace(
        match_counts=counts,
        source_index=flow.source_index[first:],
        target_index=flow.target_index[first:],
        flow=flow.flow[first:],
        confidence=flow.confidence[first:],
    )
    followed = follow_flow(hinge.sequence.frames()[2], hinge.sequence, known, 2, 3)
    np.testing.assert_array_equal(followed[0], followed[1])
    assert (followed[3] != followed[2]).any()


def with_confidence(flow, confidence):
    return flow.replace(confidence=np.asarray(confidence, dtype=np.float64))


def test_unsure_matches_hardly_lead_astray_and_sure_ones_count_alike(hinge):
    flow, rng = hinge.true_flow(), np.random.default_rng(0)
    wrong = rng.uniform(size=len(flow.flow)) < 0.1
    astray = flow.replace(flow=np.where(wrong[:, None], rng.normal(size=flow.flow.shape), flow.flow))

    def follow(flow):
        return follow_flow(hinge.sequence.frames()[2], hinge.sequence, flow, 2, 3)

    sure = np.exp(-0.5 * rng.uniform(0, 2, size=len(wrong)) ** 2)
    np.testing.assert_array_equal(follow(with_confidence(flow, sure)), follow(flow))
    misses = [
        np.linalg.norm(follow(with_confidence(astray, np.where(wrong, unsure, 1.0))) - follow(flow), axis=-1).mean()
        for unsure in (0.0, 0.02, 1.0)
    ]
    assert misses[0] < 0.1 * misses[2]
    assert misses[0] < misses[1] < misses[2]
