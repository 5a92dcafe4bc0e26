"""Whatever a user's own estimator returns ends in a flow, or in one line that names it and what is wrong."""

import numpy as np
import pytest

from schemas.config import FlowConfig
from stages.flow.pair import PairFlow
from stages.flow.stage import ESTIMATORS, compute_flow

RNG = np.random.default_rng(0)


def pair(**changes):
    values = {
        "source_index": np.arange(4),
        "target_index": np.arange(4),
        "flow": np.zeros((4, 3)),
        "confidence": np.ones(4),
    }
    return PairFlow(**(values | changes))


def test_a_sound_answer_becomes_a_flow(hinge, monkeypatch):
    monkeypatch.setitem(ESTIMATORS, "mine", lambda *args: [pair()] * 4)
    assert compute_flow(hinge.sequence, FlowConfig(estimator="mine"), RNG).match_counts.tolist() == [4] * 4


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "found a NoneType, expected 4 for 5 frames"),
        ([pair()] * 3, "found 3 pairs, expected 4 for 5 frames"),
        ([pair(), None, pair(), pair()], "pair 1: found a NoneType, expected a PairFlow"),
        ([pair(source_index=np.array([0, 1, 2, 400]))] * 4, "pair 0: source_index in 0..400, expected 0..399"),
        ([pair(), pair(target_index=np.array([-1, 1, 2, 3])), *[pair()] * 2], "pair 1: target_index in -1..3"),
        ([pair(target_index=np.arange(3))] * 4, "pair 0: found arrays of shapes"),
        ([pair(flow=np.zeros((4, 2)))] * 4, "pair 0: found arrays of shapes"),
        ([pair(source_index=5)] * 4, "pair 0: found arrays of shapes"),
        ([pair(source_index=np.arange(4.0))] * 4, "Flow.source_index: found dtype float64"),
        ([pair(flow=np.full((4, 3), np.nan))] * 4, "Flow.flow: 48 values are NaN"),
        ([pair(flow=np.full((4, 3), 1e20))] * 4, "Flow.flow: found a number of size 1e+20"),
        ([pair(confidence=np.full(4, 1.5))] * 4, "Flow.confidence: found values in 1.5..1.5, expected 0..1"),
    ],
)
def test_a_wrong_answer_is_told_in_one_line(hinge, monkeypatch, answer, message):
    monkeypatch.setitem(ESTIMATORS, "mine", lambda *args: answer)
    with pytest.raises(ValueError, match=r"^flow\.estimator 'mine'") as caught:
        compute_flow(hinge.sequence, FlowConfig(estimator="mine"), RNG)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
