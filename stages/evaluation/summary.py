"""From the metrics of single sequences to figures that can be averaged, and their means."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from schemas.metrics import JointMetrics, Metrics
from schemas.scores import MEASURES, Figures, SequenceScore, StageCost
from schemas.sequence import METRES

MOVING = 3.0  # point spacings; a true joint with a longer way can be told from one that stands still


def figures_of(metrics: Metrics, costs: Mapping[str, StageCost]) -> Figures:
    """The figures of one sequence; lengths in centimetres only where the input's unit is known."""
    scale = 100 * METRES[metrics.units] if metrics.units in METRES else None
    lengths = {"recon_cm": metrics.recon, "epe_cm": metrics.epe, "reanimation_cm": metrics.reanimation}
    centimetres = {name: None if scale is None or of is None else of * scale for name, of in lengths.items()}
    same = {name: getattr(metrics, name) for name in Figures.model_fields if name in Metrics.model_fields}
    memory = [cost.peak_memory_mib for cost in costs.values() if cost.peak_memory_mib is not None]
    counted = {
        "parts_off": None if metrics.parts_true is None else abs(metrics.parts_found - metrics.parts_true),
        "oversplit": None if metrics.parts_true is None else float(metrics.parts_found > 2 * metrics.parts_true),
        "flagged": None if metrics.trust is None else float(metrics.trust != "good"),
        "joints_found": sum(joint.predicted_type is not None for joint in metrics.joints) if metrics.joints else None,
        "joints_true": len(metrics.joints) or None,
        "seconds": sum(cost.seconds for cost in costs.values()) if costs else None,
        "peak_memory_mib": max(memory, default=None),
    }
    return Figures.model_validate(same | centimetres | counted | _joint_figures(metrics.joints))


def mean_figures(scores: Sequence[SequenceScore]) -> Figures:
    """Means over those sequences that have a figure; those of joints over all matched joints together."""
    means = {name: _mean(getattr(score.figures, name) for score in scores) for name in MEASURES}
    return Figures.model_validate(means | _joint_figures([joint for score in scores for joint in score.metrics.joints]))


def total_cost(costs: Iterable[StageCost]) -> StageCost:
    """What the tasks of one stage took together: their seconds, and the hungriest one's memory."""
    costs = list(costs)
    memory = [cost.peak_memory_mib for cost in costs if cost.peak_memory_mib is not None]
    return StageCost(seconds=sum(cost.seconds for cost in costs), peak_memory_mib=max(memory, default=None))


def mean_costs(scores: Sequence[SequenceScore]) -> dict[str, StageCost]:
    """The mean cost of each stage over the sequences that it was measured on."""
    means = {}
    for stage in dict.fromkeys(stage for score in scores for stage in score.costs):
        costs = [score.costs[stage] for score in scores if stage in score.costs]
        seconds = float(np.mean([cost.seconds for cost in costs]))
        means[stage] = StageCost(seconds=seconds, peak_memory_mib=_mean(cost.peak_memory_mib for cost in costs))
    return means


def _joint_figures(joints: Sequence[JointMetrics]) -> dict[str, float | None]:
    matched = [joint for joint in joints if joint.predicted_type is not None]
    moving = [joint for joint in joints if joint.travel_spacings is not None and joint.travel_spacings > MOVING]
    return {
        "moving_joints_found": _mean(float(joint.predicted_type is not None) for joint in moving),
        "axis_angle_deg": _median(joint.axis_angle_deg for joint in matched),
        "axis_angle_mean_deg": _mean(joint.axis_angle_deg for joint in matched),
        "axis_distance_percent": _median(joint.axis_distance_percent for joint in matched),
        "ball_centre_percent": _mean(joint.ball_centre_percent for joint in matched),
        "within_one": _mean(float(share <= 1) for share in _shares_of_spread(matched)),
        "within_two": _mean(float(share <= 2) for share in _shares_of_spread(matched)),
        "joint_type_accuracy": _mean(float(joint.predicted_type == joint.true_type) for joint in matched),
    }


def _shares_of_spread(joints: Iterable[JointMetrics]) -> Iterator[float]:
    """The errors of directions and places in units of their spreads."""
    for joint in joints:
        for error, spread in (
            (joint.axis_angle_deg, joint.direction_spread_deg),
            (joint.place_percent, joint.place_spread_percent),
        ):
            if error is not None and spread is not None:
                yield error / max(spread, 1e-12)


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
