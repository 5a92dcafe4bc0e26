"""Estimator `hybrid`: `geometric` with an additional start for large motions, from matches of descriptors.

If the alignment by `geometric` leaves more than sampling noise between two frames, their descriptors are matched. Many
matches may be wrong. Rigid pieces that explain the matches and the target form a start for the same deformation graph.
Its result is used if it fits better. Without matches the estimator equals `geometric`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from jaxtyping import Float64

from schemas.config import FlowConfig, GeometricFlowConfig
from stages.flow.geometric import REACH_FINE, FramePair, align_all, follow
from stages.flow.match import MOST_POINTS, Describe, Described, Estimator, match_features, places
from stages.flow.pair import PairFlow
from stages.flow.piecewise_rigid import Nodes, Surface, piecewise_rigid
from stages.kernels.points.sampling import working_points
from stages.support.progress import Progress

GOOD_COST = 0.42  # an alignment of lower cost leaves only sampling noise


def hybrid_of(*describes: Describe) -> Estimator:
    """Make the estimator that uses the matches of all given descriptors together."""

    def estimate(
        frames: Sequence[Float64[np.ndarray, "points 3"]],
        config: FlowConfig,
        rng: np.random.Generator,
        progress: Progress,
    ) -> list[PairFlow]:
        """Estimate the flow of each consecutive pair of frames. `rng` draws triples of matches."""

        @cache
        def described(t: int) -> list[Described]:
            points = frames[t][working_points(frames[t], MOST_POINTS)]
            return [Described(points, describe(points, config)) for describe in describes]

        def improved(t: int, pair: FramePair, Ts: Float64[np.ndarray, "nodes 4 4"]) -> Float64[np.ndarray, "nodes 4 4"]:
            if pair.fine.cost(Ts, REACH_FINE) <= GOOD_COST:
                return Ts
            both = zip(described(t), described(t + 1), strict=True)
            matched = [places(source, target, match_features(source, target)) for source, target in both]
            p_from, p_to = map(np.concatenate, zip(*matched, strict=True))
            return better_motion(pair, Ts, p_from, p_to, config.geometric, rng)

        return align_all(frames, config.geometric, progress, improved)

    return estimate


def better_motion(
    pair: FramePair,
    Ts: Float64[np.ndarray, "nodes 4 4"],
    p_from: Float64[np.ndarray, "matches 3"],
    p_to: Float64[np.ndarray, "matches 3"],
    config: GeometricFlowConfig,
    rng: np.random.Generator,
) -> Float64[np.ndarray, "nodes 4 4"]:
    """The motion of the fine nodes from a start by matches, if it fits better than `Ts`; else `Ts`."""
    if len(p_from) < 3:  # too few for a rigid motion
        return Ts
    fine, graph = pair.fine, pair.fine.graph
    nodes = Nodes(graph.p_nodes, graph.edges[graph.edges[:, 0] < graph.edges[:, 1]], graph.anchors[:, 0].copy())
    surfaces = Surface.of(fine.source), Surface.of(fine.target)
    start = piecewise_rigid(nodes, *surfaces, p_from, p_to, fine.spacing, rng)
    # only the last, softest level, since stiffer ones distort joints that bend far
    found = follow(fine, start, config, slice(-1, None))
    return min((Ts, found), key=lambda motion: fine.cost(motion, REACH_FINE))
