import numpy as np


def test_pairs_own_consecutive_rows(samples):
    flow = samples["flow"].replace(match_counts=np.array([1, 3]))
    (source, _, displacement, _), (source_2, target_2, _, confidence_2) = flow.pairs()
    assert (source.tolist(), source_2.tolist(), target_2.tolist()) == ([0], [1, 2, 3], [2, 1, 0])
    assert np.array_equal(displacement, flow.flow[:1])
    assert len(confidence_2) == 3


def test_a_pair_may_have_no_match(samples):
    assert [len(pair[0]) for pair in samples["flow_without_matches"].pairs()] == [0, 0]
