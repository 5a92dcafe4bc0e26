"""Which frames are matched with each other: those that look alike, whatever their order."""

from __future__ import annotations

from collections.abc import Sequence

import networkx as nx
import numpy as np
from jaxtyping import Float64

from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import working_points

POINTS = 400
MOST_FRAMES = 40  # of more frames only neighbours in time are matched
AS_GOOD = 1.15  # times the least sum of differences: the given order is kept


def matching_paths(frames: Sequence[Float64[np.ndarray, "points 3"]]) -> list[list[int]]:
    """Paths over the frames whose consecutive pairs form a tree of frames that look alike.

    It is one path, the given order, where that is about as good, or where there are many frames. Each further path
    starts at a frame of an earlier one.
    """
    in_order = list(range(len(frames)))
    if not 2 < len(frames) <= MOST_FRAMES:
        return [in_order]
    difference = frame_differences(frames)
    tree = nx.minimum_spanning_tree(nx.from_numpy_array(difference + 1e-12))
    if difference[in_order[:-1], in_order[1:]].sum() <= AS_GOOD * sum(difference[a, b] for a, b in tree.edges):
        return [in_order]
    return _paths(tree)


def frame_differences(frames: Sequence[Float64[np.ndarray, "points 3"]]) -> Float64[np.ndarray, "frames frames"]:
    """The mean distance between each two frames' points, in both directions."""
    thin = [np.ascontiguousarray(frame[working_points(frame, POINTS)]) for frame in frames]
    trees = [KDTree(cloud) for cloud in thin]
    one_way = np.array([[nearest(tree, cloud)[0].mean() for cloud in thin] for tree in trees])
    return (one_way + one_way.T) / 2


def _paths(tree: nx.Graph) -> list[list[int]]:
    """Cut a tree into paths: a longest one by number of frames, then longest branches off what is covered."""
    end = list(nx.bfs_tree(tree, 0))[-1]
    paths = [max(nx.single_source_shortest_path(tree, end).values(), key=len)]
    covered = set(paths[0])
    while len(covered) < len(tree):
        branches = nx.multi_source_dijkstra_path(tree, covered, weight=None)
        paths.append(max(branches.values(), key=len))
        covered |= set(paths[-1])
    return paths
