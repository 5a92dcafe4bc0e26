import numpy as np
import pytest

from schemas.assessment import Evidence, Spread
from stages.assessment.verdict import verdict_on

NAMES = ("a.ply", "b.ply", "c.ply")


@pytest.fixture
def model(samples):
    return samples["kinematic"].replace(confidence=np.ones((2, 3)))


def evidence(**changes):
    usual = {
        "excess": np.array([1.05, 1.0, 1.1]),
        "unexplained": np.array([0.001, 0.0, 0.002]),
        "firmness": np.array([0.98, 0.95, 0.97]),
        "open_share": 0.02,
    }
    return Evidence(**usual | changes)


SPREADS = (Spread(direction=0.01, place=0.001), Spread(direction=0.01))


def test_a_model_that_fits_is_good_and_says_how_well(model):
    verdict = verdict_on(model, SPREADS, evidence(), NAMES)
    assert verdict.trust == "good"
    [sentence] = verdict.reasons
    assert "1.08 times" in sentence  # the canonical frame does not count


@pytest.mark.parametrize(
    ("changes", "trust", "words"),
    [
        ({"unexplained": np.array([0.5, 0.0, 0.0])}, "poor", "a.ply"),
        ({"excess": np.array([1.0, 1.0, 4.0])}, "poor", "c.ply"),
        ({"unexplained": np.array([0.1, 0.0, 0.0])}, "doubtful", "up to 10 % of a frame's points"),
        ({"firmness": np.array([0.99, 0.6, 0.9]), "open_share": 0.15}, "doubtful", "15 % of the points"),
        ({"firmness": np.array([0.85, 0.85, 0.85])}, "doubtful", "part_0, part_1, part_2"),
        ({"firmness": np.array([0.9, 0.1, 0.2])}, "poor", "where part_1, part_2 end"),
    ],
)
def test_what_the_clouds_say_against_a_model(model, changes, trust, words):
    verdict = verdict_on(model, SPREADS, evidence(**changes), NAMES)
    assert verdict.trust == trust
    assert words in verdict.reasons[0]


@pytest.mark.parametrize(
    ("column", "words"), [(0, "no joint may be needed"), (1, "may hang on another"), (2, "another type")]
)
def test_an_uncertain_joint_is_named_with_the_reason(model, column, words):
    confidence = np.ones((2, 3))
    confidence[1, column] = 0.1
    verdict = verdict_on(model.replace(confidence=confidence), SPREADS, evidence(), NAMES)
    assert verdict.trust == "doubtful"
    assert "joint_1_2" in verdict.reasons[0]
    assert words in verdict.reasons[0]
    assert "0.10" in verdict.reasons[0]


def test_an_axis_that_is_hardly_known_is_told_in_degrees(model):
    verdict = verdict_on(model, (Spread(direction=np.radians(40)), SPREADS[1]), evidence(), NAMES)
    assert verdict.trust == "doubtful"
    assert "joint_0_1" in verdict.reasons[0]
    assert "40 degrees" in verdict.reasons[0]


def test_that_nothing_moved_is_said(samples):
    of_one = evidence(firmness=np.array([1.0]))
    verdict = verdict_on(samples["single_part"], (), of_one, NAMES)
    assert verdict.trust == "poor"
    assert verdict.reasons[0].startswith("nothing moved")


def test_frames_that_do_not_fit_are_said_first_and_only_some_are_named(model):
    names = [f"{t}.ply" for t in range(6)]
    bad = evidence(
        excess=np.ones(6), unexplained=np.array([0.9, 0.0, 0.9, 0.9, 0.9, 0.9]), firmness=np.array([0.1, 0.1, 0.1])
    )
    reasons = verdict_on(model, SPREADS, bad, names).reasons
    assert "0.ply, 2.ply, 3.ply and 2 more" in reasons[0]
    assert "fit another part's motion as well" in reasons[1]
