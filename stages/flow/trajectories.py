"""Trajectories of points through the whole sequence, along the flow."""

from __future__ import annotations

from collections.abc import Iterator

import networkx as nx
import numpy as np
from jaxtyping import Float64

from schemas.flow import Flow, FlowPair
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
    """Trajectories of points of the canonical frame, by chaining the flow of pairs forwards and backwards.

    Each frame is reached along the surest way: the minimum spanning tree over the pairs' costs. Matches of low
    confidence have less weight. Frames that no pair reaches, and pairs without matches, leave points where they are.
    """
    frames = sequence.frames()
    trajectories = np.tile(p_canonical, (len(frames), 1, 1))
    for pair, forwards in surest_way(flow, len(frames), canonical_frame):
        here, there = (pair.source_frame, pair.target_frame) if forwards else (pair.target_frame, pair.source_frame)
        p = trajectories[here]
        if len(pair.source_index) == 0:
            trajectories[there] = p
            continue
        starts = frames[pair.source_frame][pair.source_index]
        tree = KDTree(starts if forwards else starts + pair.flow)
        motion = interpolate(tree, pair.flow, p, neighbours, _weights(pair.confidence))[0]
        trajectories[there] = p + motion if forwards else p - motion
    return trajectories


def surest_way(flow: Flow, frame_count: int, canonical_frame: int) -> Iterator[tuple[FlowPair, bool]]:
    """The pairs of the minimum spanning tree over pair costs, outwards from the canonical frame.

    With each comes whether it leads outwards from its source to its target. Of parallel pairs the surest counts.
    """
    graph = nx.Graph()
    graph.add_nodes_from(range(frame_count))
    for pair in sorted(flow.pairs(), key=lambda pair: -pair.cost):
        graph.add_edge(pair.source_frame, pair.target_frame, weight=pair.cost, pair=pair)
    tree = nx.minimum_spanning_tree(graph)
    for here, there in nx.bfs_edges(tree, canonical_frame):
        pair = tree.edges[here, there]["pair"]
        yield pair, pair.source_frame == here


def _weights(confidence: Float64[np.ndarray, "matches"]) -> Float64[np.ndarray, "matches"]:
    return np.clip(confidence / SURE, LEAST_WEIGHT, 1.0)
