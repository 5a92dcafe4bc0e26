"""Whatever a user's own solver returns ends in a model, or in one line that names it and what is wrong."""

import numpy as np
import pytest

from schemas.config import RelaxedFitConfig
from schemas.relaxed import RelaxedModel
from stages.relaxed_fit.stage import SOLVERS, compute_relaxed_fit


def model(**changes):
    values = {
        "canonical_frame": 2,
        "labels": np.repeat([0, 1], 200),
        "Ts_frame_canonical": np.tile(np.eye(4), (5, 2, 1, 1)),
        "energy_history": np.zeros((1, 4)),
        "solver": "mine",
        "iterations": 1,
    }
    return RelaxedModel(**(values | changes))


def bent(entry, value):
    Ts = np.tile(np.eye(4), (5, 2, 1, 1))
    Ts[(3, 1, *entry)] = value
    return Ts


def fit(hinge, monkeypatch, **changes):
    monkeypatch.setitem(SOLVERS, "mine", lambda *args: model(**changes))
    config = RelaxedFitConfig(solver="mine")
    return compute_relaxed_fit(hinge.sequence, hinge.true_flow(), 2, config, np.random.default_rng(0))


def test_a_sound_answer_is_handed_on(hinge, monkeypatch):
    assert len(fit(hinge, monkeypatch).labels) == 400


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"labels": np.repeat([0, 7], 200)},
            "RelaxedModel.labels: found values in 0..7, expected 0..1, since parts = 2",
        ),
        ({"labels": np.repeat([-1, 1], 200)}, "RelaxedModel.labels: found values in -1..1"),
        ({"labels": np.zeros(400, dtype=np.int64)}, "RelaxedModel.labels: found [0], expected every part 0..1"),
        ({"labels": np.repeat([0, 1], 100)}, "found 200 labels and 5 frames, expected 400 and 5"),
        ({"canonical_frame": 5}, "RelaxedModel.canonical_frame: found values in 5..5, expected 0..4, since frames = 5"),
        ({"canonical_frame": 1}, "found canonical frame 1, expected 2"),
        ({"Ts_frame_canonical": bent((0, 0), 2.0)}, "Ts_frame_canonical: found others than rigid motions"),
        (
            {"Ts_frame_canonical": bent((0, 0), -1.0)},
            "Ts_frame_canonical: found others than rigid motions",
        ),
        ({"Ts_frame_canonical": bent((3, 0), 0.5)}, "Ts_frame_canonical: found others than rigid motions"),
        ({"Ts_frame_canonical": bent((0, 0), 1e300)}, "RelaxedModel.Ts_frame_canonical: found a number of size 1e+300"),
        ({"Ts_frame_canonical": bent((0, 3), np.nan)}, "RelaxedModel.Ts_frame_canonical: 1 values are NaN"),
        ({"iterations": -1}, "RelaxedModel.iterations: Input should be greater than or equal to 0"),
    ],
)
def test_a_wrong_answer_is_told_in_one_line(hinge, monkeypatch, changes, message):
    with pytest.raises(ValueError, match=r"^relaxed_fit\.solver 'mine'") as caught:
        fit(hinge, monkeypatch, **changes)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_something_else_than_a_model_is_told(hinge, monkeypatch):
    monkeypatch.setitem(SOLVERS, "mine", lambda *args: None)
    with pytest.raises(ValueError, match="found a NoneType, expected a RelaxedModel"):
        compute_relaxed_fit(
            hinge.sequence, hinge.true_flow(), 2, RelaxedFitConfig(solver="mine"), np.random.default_rng(0)
        )
