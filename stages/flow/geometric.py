"""Estimator `geometric`: robust coarse-to-fine non-rigid alignment, then mutual nearest neighbours.

It needs no training. A deformation graph aligns each pair while its stiffness is lowered step by step. A coarse graph
tries several starts: at rest or with the motion of the previous pair, and stiff first or soft at once. A fine graph
continues from the best one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from schemas.config import FlowConfig, GeometricFlowConfig
from stages.flow.deformation_graph import Alignment, DeformationGraph, build_graph, deform
from stages.flow.pair import PairFlow, mutual_matches
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points, normals, point_spacing, working_points
from stages.support.progress import Progress

REACH_COARSE, REACH_FINE = 10.0, 2.0  # robust reach at the first and last stiffness, in spacings


@dataclass(frozen=True)
class NodeMotion:
    """The final positions of a solved pair's nodes, and their motions."""

    p_nodes: Float64[np.ndarray, "nodes 3"]
    Ts: Float64[np.ndarray, "nodes 4 4"]


def estimate_geometric(
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    config: FlowConfig,
    rng: np.random.Generator,
    progress: Progress,
) -> list[PairFlow]:
    """Estimate the flow of each consecutive pair of frames. It is deterministic; `rng` is unused."""
    return align_all(frames, config.geometric, progress, lambda t, pair, Ts: Ts)


def align_all(
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    config: GeometricFlowConfig,
    progress: Progress,
    improved: Callable[[int, FramePair, Float64[np.ndarray, "nodes 4 4"]], Float64[np.ndarray, "nodes 4 4"]],
) -> list[PairFlow]:
    """Align each consecutive pair of frames. `improved` may replace the nodes' motion in the t-th pair.

    The next pair starts from the motion before this improvement.
    """
    pairs: list[PairFlow] = []
    previous: NodeMotion | None = None
    for t in range(len(frames) - 1):
        pair = FramePair.of(frames[t], frames[t + 1], config)
        previous = align(pair, config, previous)
        pairs.append(pair.flow(improved(t, pair, previous.Ts), config.max_distance))
        progress(t + 1, len(frames) - 1)
    return pairs


@dataclass(frozen=True)
class FramePair:
    """Two frames and the alignments of their working points, by few nodes and by many."""

    source: Float64[np.ndarray, "points 3"]
    target: Float64[np.ndarray, "targets 3"]
    coarse: Alignment
    fine: Alignment

    @classmethod
    def of(
        cls,
        source: Float64[np.ndarray, "points 3"],
        target: Float64[np.ndarray, "targets 3"],
        config: GeometricFlowConfig,
    ) -> FramePair:
        """Thin two frames and spread the nodes over them."""
        working = source[working_points(source, config.points)]
        working_target = target[working_points(target, config.points)]
        spacing = point_spacing(working_target)
        fine = _alignment(working, working_target, config.nodes, config.neighbours, spacing)
        coarse = _alignment(
            working[farthest_points(working, config.coarse_points)],
            working_target[farthest_points(working_target, config.coarse_points)],
            min(config.coarse_nodes, config.nodes),
            config.neighbours,
            spacing,
        )
        return cls(source, target, coarse, fine)

    def flow(self, Ts: Float64[np.ndarray, "nodes 4 4"], max_distance: float) -> PairFlow:
        """The flow of all points by the motions of the fine nodes."""
        warped = _warp_all(self.fine.graph, Ts, self.fine.source, self.source)
        return mutual_matches(self.source, warped, self.target, point_spacing(self.target), max_distance)


def align(pair: FramePair, config: GeometricFlowConfig, previous: NodeMotion | None) -> NodeMotion:
    """The motion of the fine nodes, from the best of several starts. `previous` is that of the previous pair."""
    Ts = _coarse_to_fine(pair.coarse, pair.fine, previous, config)
    return NodeMotion(move_points(Ts, pair.fine.graph.p_nodes), Ts)


def _alignment(
    source: Float64[np.ndarray, "points 3"],
    target: Float64[np.ndarray, "targets 3"],
    nodes: int,
    neighbours: int,
    spacing: float,
) -> Alignment:
    return Alignment(build_graph(source, nodes, neighbours), source, target, normals(target), spacing)


def _coarse_to_fine(
    coarse: Alignment, fine: Alignment, previous: NodeMotion | None, config: GeometricFlowConfig
) -> Float64[np.ndarray, "nodes 4 4"]:
    """The motion of the fine nodes, which continue from the best coarse one.

    The coarse graph goes from every start to the middle of the schedule, both stiff first and soft at once. Stiff first
    carries whole limbs over large motions. Soft at once keeps still parts in place. The fine graph does the rest.
    """
    levels = len(config.stiffness)
    middle = levels // 2
    p_nodes = coarse.graph.p_nodes
    starts = [np.tile(np.eye(4), (len(p_nodes), 1, 1))]
    if previous is not None:
        starts.append(previous.Ts[nearest(KDTree(previous.p_nodes), p_nodes)[1]])
    reached = [
        follow(coarse, start, config, slice(first, middle + 1))
        for start in starts
        for first in dict.fromkeys((0, middle))
    ]
    best = min(reached, key=lambda Ts: coarse.cost(Ts, REACH_FINE))
    # a fine node follows the coarse node nearest along the surface, so that touching limbs move separately
    coarse_node = coarse.graph.anchors[nearest(KDTree(coarse.source), fine.graph.p_nodes)[1], 0]
    return follow(fine, best[coarse_node], config, slice(min(middle + 1, levels - 1), levels))


def follow(
    alignment: Alignment, Ts: Float64[np.ndarray, "nodes 4 4"], config: GeometricFlowConfig, levels: slice
) -> Float64[np.ndarray, "nodes 4 4"]:
    """Continue the nodes' motion through the given levels of the schedule, stiff to soft."""
    schedule = zip(config.stiffness, np.geomspace(REACH_COARSE, REACH_FINE, len(config.stiffness)), strict=True)
    for stiffness, reach in list(schedule)[levels]:
        for _ in range(config.iterations):
            Ts = alignment.step(Ts, stiffness, reach)
    return Ts


def _warp_all(
    graph: DeformationGraph,
    Ts: Float64[np.ndarray, "nodes 4 4"],
    working: Float64[np.ndarray, "working 3"],
    points: Float64[np.ndarray, "points 3"],
) -> Float64[np.ndarray, "points 3"]:
    """Move all points. Each moves like the nearest working point."""
    nearby = nearest(KDTree(working), points)[1]
    whole = DeformationGraph(graph.p_nodes, graph.anchors[nearby], graph.weights[nearby], graph.edges)
    return deform(whole, Ts, points)
