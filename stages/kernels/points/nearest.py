"""Nearest neighbours on point clouds."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64
from pykdtree.kdtree import KDTree

__all__ = ["FEW_NEIGHBOURS", "SURFACE_NEIGHBOURS", "KDTree", "nearest", "neighbours"]

# nearest points that stand for a point's surroundings on its surface: enough to link what belongs together, and so few
# in graphs of a single cloud that gaps stay open
SURFACE_NEIGHBOURS, FEW_NEIGHBOURS = 8, 6


def nearest(
    tree: KDTree, queries: Float[np.ndarray, "queries 3"]
) -> tuple[Float[np.ndarray, "queries"], Int64[np.ndarray, "queries"]]:
    """Distance to, and index of, the nearest point in the tree for each query."""
    distances, indices = tree.query(np.ascontiguousarray(queries))
    return distances, indices.astype(np.int64)


def neighbours(
    points: Float[np.ndarray, "points 3"], count: int
) -> tuple[Float[np.ndarray, "points count"], Int64[np.ndarray, "points count"]]:
    """Distances to, and indices of, the nearest other points of each point, nearest first.

    `count` is cut to the number of other points.
    """
    count = min(count, len(points) - 1)
    distances, indices = KDTree(points).query(points, k=count + 1)
    # the nearest of all is the point itself, unless it has exact duplicates
    return distances[:, 1:].reshape(len(points), count), indices[:, 1:].astype(np.int64).reshape(len(points), count)
