import numpy as np


def test_pairs_own_consecutive_rows(samples):
    flow = samples["flow"].replace(match_counts=np.array([1, 3]))
    first, second = flow.pairs()
    assert [(pair.source_frame, pair.target_frame, pair.cost) for pair in (first, second)] == [(0, 1, 0.1), (1, 2, 0.2)]
    assert (first.source_index.tolist(), second.source_index.tolist()) == ([0], [1, 2, 3])
    assert second.target_index.tolist() == [2, 1, 0]
    assert np.array_equal(first.flow, flow.flow[:1])
    assert len(second.confidence) == 3


def test_a_pair_may_have_no_match(samples):
    assert [len(pair.source_index) for pair in samples["flow_without_matches"].pairs()] == [0, 0]
