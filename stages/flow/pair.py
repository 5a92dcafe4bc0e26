"""The flow of one pair of frames, as an estimator returns it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.points.nearest import KDTree, nearest


@dataclass(frozen=True)
class PairFlow:
    """Matched points of frames t and t + 1, with the source points' displacement and its confidence in [0, 1]."""

    source_index: Int64[np.ndarray, "matches"]
    target_index: Int64[np.ndarray, "matches"]
    flow: Float64[np.ndarray, "matches 3"]
    confidence: Float64[np.ndarray, "matches"]


def mutual_matches(
    source: Float64[np.ndarray, "points 3"],
    warped: Float64[np.ndarray, "points 3"],
    target: Float64[np.ndarray, "targets 3"],
    spacing: float,
    max_distance: float,
) -> PairFlow:
    """Match source and target points that are mutual nearest neighbours once the source is warped onto the target.

    Pairs farther apart than `max_distance`, in units of `spacing` (the target's spacing), are dropped. The confidence
    falls with the distance as a Gaussian of one spacing. The flow is the displacement by the warp, which is free of the
    matched points' sampling noise.
    """
    distance, forward = nearest(KDTree(target), warped)
    backward = nearest(KDTree(warped), target)[1]
    index = np.arange(len(warped))
    kept = np.flatnonzero((backward[forward] == index) & (distance <= max_distance * spacing))
    return PairFlow(
        source_index=kept,
        target_index=forward[kept],
        flow=warped[kept] - source[kept],
        confidence=np.exp(-0.5 * (distance[kept] / spacing) ** 2),
    )
