"""Estimator `geometric`: robust coarse-to-fine non-rigid alignment, then mutual nearest neighbours.

Needs no training. Each pair is aligned by a deformation graph whose stiffness is lowered step by step,
from several starts (still, or going on as in the pair before; stiff first, or soft at once), of which
the one that fits best is followed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from schemas.config import FlowConfig, GeometricFlowConfig
from stages.flow.pair import PairFlow, mutual_matches
from stages.kernels.deformation_graph import Alignment, DeformationGraph, build_graph, deform
from stages.kernels.nearest import KDTree, nearest
from stages.kernels.registration import move_points
from stages.kernels.sampling import farthest_points, normals, spacing
from stages.progress import Progress

REACH_COARSE, REACH_FINE = 10.0, 2.0  # robust reach at the first and last stiffness, in spacings


@dataclass(frozen=True)
class NodeMotion:
    """Where a solved pair's nodes ended and the motion that took them there."""

    p_nodes: Float64[np.ndarray, "nodes 3"]
    Ts: Float64[np.ndarray, "nodes 4 4"]


def estimate_geometric(
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    config: FlowConfig,
    rng: np.random.Generator,
    progress: Progress,
) -> list[PairFlow]:
    """Flow of each consecutive pair of frames; deterministic, `rng` is not drawn from."""
    pairs: list[PairFlow] = []
    previous: NodeMotion | None = None
    for t in range(len(frames) - 1):
        pair, previous = align_pair(frames[t], frames[t + 1], config.geometric, previous)
        pairs.append(pair)
        progress(t + 1, len(frames) - 1)
    return pairs


def align_pair(
    source: Float64[np.ndarray, "points 3"],
    target: Float64[np.ndarray, "targets 3"],
    config: GeometricFlowConfig,
    previous: NodeMotion | None = None,
) -> tuple[PairFlow, NodeMotion]:
    """Flow from `source` to `target`, and the nodes' motion as a start for the next pair."""
    working = source[farthest_points(source, config.points)]
    working_target = target[farthest_points(target, config.points)]
    graph = build_graph(working, config.nodes, config.neighbours)
    alignment = Alignment(graph, working, working_target, normals(working_target), spacing(working_target))
    still = np.tile(np.eye(4), (len(graph.p_nodes), 1, 1))
    starts = [still]
    if previous is not None:
        starts.append(previous.Ts[nearest(KDTree(previous.p_nodes), graph.p_nodes)[1]])
    Ts = _coarse_to_fine(alignment, starts, config)
    warped = _warp_all(graph, Ts, working, source)
    pair = mutual_matches(source, warped, target, spacing(target), config.max_distance)
    return pair, NodeMotion(move_points(Ts, graph.p_nodes), Ts)


def _coarse_to_fine(
    alignment: Alignment, starts: list[Float64[np.ndarray, "nodes 4 4"]], config: GeometricFlowConfig
) -> Float64[np.ndarray, "nodes 4 4"]:
    """From every start, stiff first and soft at once, to the middle of the schedule; the best goes on to its end.

    Stiff first carries whole limbs over far motions; soft at once keeps what stands still where it is.
    """
    levels = len(config.stiffness)
    reaches = np.geomspace(REACH_COARSE, REACH_FINE, levels)
    schedule = list(zip(config.stiffness, reaches, strict=True))
    middle = levels // 2

    def follow(Ts: Float64[np.ndarray, "nodes 4 4"], levels: slice) -> Float64[np.ndarray, "nodes 4 4"]:
        for stiffness, reach in schedule[levels]:
            for _ in range(config.iterations):
                Ts = alignment.step(Ts, stiffness, reach)
        return Ts

    reached = [follow(start, slice(first, middle + 1)) for start in starts for first in dict.fromkeys((0, middle))]
    best = min(reached, key=lambda Ts: alignment.cost(Ts, REACH_FINE))
    return follow(best, slice(middle + 1, levels))


def _warp_all(
    graph: DeformationGraph,
    Ts: Float64[np.ndarray, "nodes 4 4"],
    working: Float64[np.ndarray, "working 3"],
    points: Float64[np.ndarray, "points 3"],
) -> Float64[np.ndarray, "points 3"]:
    """All points, moved as the working point nearest to each is."""
    nearby = nearest(KDTree(working), points)[1]
    whole = DeformationGraph(graph.p_nodes, graph.anchors[nearby], graph.weights[nearby], graph.edges)
    return deform(whole, Ts, points)
