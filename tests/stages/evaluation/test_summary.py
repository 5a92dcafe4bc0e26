import numpy as np
import pytest

from schemas.metrics import JointMetrics
from schemas.scores import SequenceScore, StageCost
from stages.evaluation.summary import figures_of, mean_costs, mean_figures, total_cost


def joint(angle=None, true_type="revolute", predicted_type="revolute", travel=None):
    return JointMetrics(
        name="joint",
        true_type=true_type,
        predicted_type=predicted_type,
        axis_angle_deg=angle,
        travel_spacings=travel,
    )


@pytest.fixture
def score(samples):
    def scored(name="box", costs=None, **metrics):
        costs = costs or {}
        measured = samples["metrics"].replace(**metrics)
        return SequenceScore(
            sequence=name, metrics=measured, figures=figures_of(measured, costs), costs=costs, result=None
        )

    return scored


@pytest.mark.parametrize(("units", "expected"), [("metre", 0.5), ("millimetre", 0.0005), ("unknown", None)])
def test_lengths_are_in_centimetres_where_the_unit_is_known(score, units, expected):
    figures = score(units=units, recon=0.005, recon_percent=0.3).figures
    assert figures.recon_cm == (expected and pytest.approx(expected))
    assert figures.recon_percent == 0.3


def test_without_ground_truth_only_what_needs_none_is_told(score):
    figures = score(ari=None, joints=()).figures
    told = figures.model_dump(exclude_none=True)
    assert set(told) == {"parts_found", "chamfer_percent"}


def test_joints_are_measured_over_the_matched_ones(score):
    missed = joint(predicted_type=None)
    figures = score(joints=(joint(1.0), joint(3.0), joint(8.0, predicted_type="prismatic"), missed)).figures
    assert (figures.joints_found, figures.joints_true) == (3, 4)
    assert (figures.axis_angle_deg, figures.axis_angle_mean_deg) == (3.0, 4.0)
    assert figures.joint_type_accuracy == pytest.approx(2 / 3)
    assert figures.axis_distance_percent is None


def test_spreads_are_measured_over_all_directions_and_places_that_have_one(score):
    def known(angle, place, spread):
        return joint(angle).model_copy(
            update={"place_percent": place, "direction_spread_deg": spread, "place_spread_percent": spread}
        )

    figures = score(joints=(known(0.5, 1.5, 1.0), known(2.5, None, 1.0), joint(9.0))).figures
    assert figures.within_one == pytest.approx(1 / 3)
    assert figures.within_two == pytest.approx(2 / 3)
    assert score(joints=(joint(9.0),)).figures.within_one is None


def test_the_share_of_flagged_models_counts_those_that_have_a_verdict(score):
    scores = [score(trust=trust) for trust in ("good", "doubtful", "poor", None)]
    assert mean_figures(scores).flagged == pytest.approx(2 / 3)


def test_of_the_joints_that_move_by_more_than_three_spacings_the_share_found_is_told(score):
    still = [joint(travel=3.0), joint(travel=0.5, predicted_type=None)]
    moving = [joint(travel=3.1), joint(travel=30.0), joint(travel=9.0, predicted_type=None)]
    many, few = score(joints=(*still, *moving)), score(joints=(joint(travel=5.0),))
    assert many.figures.moving_joints_found == pytest.approx(2 / 3)
    assert mean_figures([many, few]).moving_joints_found == pytest.approx(3 / 4)
    assert score(joints=tuple(still)).figures.moving_joints_found is None


def test_more_than_twice_the_true_parts_are_told_as_a_share_of_the_sequences(score):
    scores = [score(parts_found=found, parts_true=3) for found in (6, 7, 2, 20)]
    assert [each.figures.oversplit for each in scores] == [0, 1, 0, 1]
    assert mean_figures(scores).oversplit == 0.5


def test_means_are_over_those_that_have_a_figure(score):
    means = mean_figures([score(ari=0.5), score(ari=0.9), score(ari=None)])
    assert means.ari == pytest.approx(0.7)
    assert means.ri is None


def test_a_joint_weighs_the_same_in_a_mean_whichever_sequence_it_belongs_to(score):
    many, one = [joint(angle) for angle in (1.0, 2.0, 3.0, 4.0)], [joint(80.0, predicted_type="prismatic")]
    means = mean_figures([score(joints=tuple(many)), score(joints=tuple(one))])
    assert means.axis_angle_deg == 3.0
    assert means.joint_type_accuracy == pytest.approx(0.8)
    assert means.joints_true == 2.5


def test_costs_add_up_over_stages_and_memory_is_that_of_the_hungriest(score):
    costs = {"flow": StageCost(seconds=2, peak_memory_mib=300), "merging": StageCost(seconds=1, peak_memory_mib=None)}
    figures = score(costs=costs).figures
    assert (figures.seconds, figures.peak_memory_mib) == (3, 300)
    assert total_cost(costs.values()) == StageCost(seconds=3, peak_memory_mib=300)
    half = {"flow": StageCost(seconds=4, peak_memory_mib=100)}
    means = mean_costs([score(costs=costs), score(costs=half)])
    assert means["flow"] == StageCost(seconds=3, peak_memory_mib=200)
    assert means["merging"] == StageCost(seconds=1, peak_memory_mib=None)
    assert np.isfinite(mean_figures([score(costs=half)]).seconds)
