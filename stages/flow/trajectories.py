"""Points followed through the whole sequence along the flow."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from schemas.flow import Flow
from schemas.sequence import PointSequence
from stages.kernels.points.nearest import KDTree

# Matches as sure as those of `geometric` (two spacings off, at worst, by default) are followed alike; less sure ones
# count for less, though never for nothing.
SURE, LEAST_WEIGHT = np.exp(-2.0), 1e-12


def interpolate(
    tree: KDTree,
    values: Float64[np.ndarray, "samples c"],
    queries: Float64[np.ndarray, "queries 3"],
    count: int,
    sample_weights: Float64[np.ndarray, "samples"] | None = None,
) -> tuple[Float64[np.ndarray, "queries c"], Float64[np.ndarray, "queries"]]:
    """Inverse-distance interpolation over the nearest `count` samples, and the distance to the nearest one.

    `sample_weights`, all positive, say what each sample counts; by default all count alike.
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
    """Where points of the canonical frame are in every frame, chaining the flow forwards and backwards.

    Of the matches around a point, those of little confidence count for less.
    """
    frames, pairs = sequence.frames(), flow.pairs()
    trajectories = np.empty((len(frames), len(p_canonical), 3))
    trajectories[canonical_frame] = p_canonical
    for t in range(canonical_frame, len(frames) - 1):
        source, _, motion, confidence = pairs[t]
        here = trajectories[t]
        if len(source) == 0:  # nothing is known of this pair: stand still
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
