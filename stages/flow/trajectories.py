"""Trajectories of points through the whole sequence, along the flow."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from schemas.flow import Flow
from schemas.sequence import PointSequence
from stages.kernels.points.nearest import KDTree

# Matches of at least the confidence SURE have equal weights. By default all matches of `geometric` do, since they are
# at most two spacings apart. Less confident ones have lower weights, but at least LEAST_WEIGHT.
SURE, LEAST_WEIGHT = np.exp(-2.0), 1e-12


def interpolate(
    tree: KDTree,
    values: Float64[np.ndarray, "samples c"],
    queries: Float64[np.ndarray, "queries 3"],
    count: int,
    sample_weights: Float64[np.ndarray, "samples"] | None = None,
) -> tuple[Float64[np.ndarray, "queries c"], Float64[np.ndarray, "queries"]]:
    """Interpolate over the nearest `count` samples by inverse distance. Also return the distance to the nearest one.

    The `sample_weights` are positive, and equal by default.
    """
    count = min(count, len(values))
    distances, indices = tree.query(np.ascontiguousarray(queries), k=count)
    distances, indices = distances.reshape(len(queries), count), indices.reshape(len(queries), count)
    weights = 1.0 / (distances + 1e-8)
    if sample_weights is not None:
        weights *= sample_weights[indices]
    weights /= weights.sum(axis=1, keepdims=True)
    return np.einsum("qk,qkc->qc", weights, values[indices]), distances[:, 0]


def follow_flow(
    p_canonical: Float64[np.ndarray, "points 3"],
    sequence: PointSequence,
    flow: Flow,
    canonical_frame: int,
    neighbours: int,
) -> Float64[np.ndarray, "frames points 3"]:
    """Trajectories of points of the canonical frame, by chaining the flow forwards and backwards.

    Matches of low confidence have less weight.
    """
    frames, pairs = sequence.frames(), flow.pairs()
    trajectories = np.empty((len(frames), len(p_canonical), 3))
    trajectories[canonical_frame] = p_canonical
    for t in range(canonical_frame, len(frames) - 1):
        source, _, motion, confidence = pairs[t]
        here = trajectories[t]
        if len(source) == 0:  # no matches in this pair: assume no motion
            trajectories[t + 1] = here
            continue
        tree = KDTree(frames[t][source])
        trajectories[t + 1] = here + interpolate(tree, motion, here, neighbours, _weights(confidence))[0]
    for t in range(canonical_frame - 1, -1, -1):
        source, _, motion, confidence = pairs[t]
        here = trajectories[t + 1]
        if len(source) == 0:
            trajectories[t] = here
            continue
        arrived = KDTree(frames[t][source] + motion)
        trajectories[t] = here - interpolate(arrived, motion, here, neighbours, _weights(confidence))[0]
    return trajectories


def _weights(confidence: Float64[np.ndarray, "matches"]) -> Float64[np.ndarray, "matches"]:
    return np.clip(confidence / SURE, LEAST_WEIGHT, 1.0)
