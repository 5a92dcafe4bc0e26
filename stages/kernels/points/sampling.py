"""Which points stand for a cloud, and what its sampling says about it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64, Int64

from stages.kernels.points.nearest import neighbours

THINNING = 8  # a cloud with so many times the wanted points is thinned at random first


def farthest_points(points: Float[np.ndarray, "points 3"], count: int) -> Int64[np.ndarray, "count"]:
    """Indices of `count` points, each farthest from those before it, from point 0 on; all when there are fewer.

    Fewer, too, where the points left are exact duplicates of chosen ones.

    Our own, since the packages for it have no wheels for some Pythons, or return points without indices.
    """
    if count >= len(points):
        return np.arange(len(points))
    axes = np.ascontiguousarray(points.T)
    chosen = np.zeros(count, dtype=np.int64)
    squared = np.full(len(points), np.inf)
    for k in range(1, count):
        x, y, z = axes - axes[:, chosen[k - 1], None]
        np.minimum(squared, x * x + y * y + z * z, out=squared)
        chosen[k] = squared.argmax()
        if squared[chosen[k]] == 0:
            return chosen[:k]
    return chosen


def working_points(points: Float[np.ndarray, "points 3"], count: int) -> Int64[np.ndarray, "count"]:
    """Indices of about `count` well spread points of a cloud of any size: all, where there are fewer.

    Of a large cloud a random eighth-fold choice (always the same) is looked at, so that time stays linear.
    """
    if len(points) <= THINNING * count:
        return farthest_points(points, count)
    chosen = thinned(len(points), THINNING * count)
    return chosen[farthest_points(points[chosen], count)]


def thinned(count: int, most: int) -> Int64[np.ndarray, "chosen"]:
    """Indices of at most `most` of `count` points, in their order: a random choice, always the same."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, most, replace=False))


def point_spacing(points: Float[np.ndarray, "points 3"]) -> float:
    """The median distance from a point to its nearest neighbour: the size of its sampling noise.

    Exact duplicates, which scans put together from several views have, count once.
    """
    return float(np.median(neighbours(np.unique(points, axis=0), 1)[0]))


def normals(points: Float[np.ndarray, "points 3"], count: int = 10) -> Float64[np.ndarray, "points 3"]:
    """Unit normals (of no particular sign): the direction in which a point's neighbourhood is thinnest."""
    near = points[neighbours(points, count)[1]]
    offsets = near - near.mean(axis=1, keepdims=True)
    covariances = np.einsum("nki,nkj->nij", offsets, offsets)
    return np.linalg.eigh(covariances)[1][:, :, 0]
