import pytest
from pydantic import ValidationError

from schemas.scores import MEASURES, Difference, Figures, Scores

EMPTY = {"dataset": "roboart", "created": "2026-01-01T00:00:00Z", "config": {}, "sequences": (), "missing": ()}


def test_every_figure_has_a_measure_and_no_two_look_alike():
    assert set(MEASURES) == set(Figures.model_fields)
    assert len({(measure.title, measure.unit) for measure in MEASURES.values()}) == len(MEASURES)


def test_errors_are_better_when_lower_and_agreement_when_higher():
    lower = {name for name, measure in MEASURES.items() if measure.better == "lower"}
    assert {name for name in MEASURES if name.startswith(("recon", "epe", "reanimation", "axis"))} <= lower
    assert {MEASURES[name].better for name in ("ari", "ri", "acc5", "acc10", "joint_type_accuracy")} == {"higher"}


def test_a_change_is_after_minus_before():
    assert Difference(before=3, after=1, verdict=None).change == -2


@pytest.mark.parametrize("change", [{"format": "other"}, {"version": 2}, {"surprise": 1}, {"groups": None}])
def test_other_evaluations_are_refused(change):
    assert Scores.model_validate(EMPTY | {"groups": ()}).version == 1
    with pytest.raises(ValidationError):
        Scores.model_validate(EMPTY | {"groups": ()} | change)
