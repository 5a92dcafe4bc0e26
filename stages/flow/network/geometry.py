"""The network's input for a cloud: well spread points, their neighbourhoods, and descriptors of shape.

The input does not depend on the sampling density, since neighbourhoods are taken among fixed numbers of farthest
points. The descriptors do not change when the object is turned or bent, unless it touches itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points

FINE, CENTRES, HUBS = 1024, 512, 128  # farthest points of the three levels; each is the beginning of the level before
FINE_GROUPS = ((1024, 16), (512, 24), (256, 24))  # (n, k): each centre's nearest k among the first n fine points
CENTRE_GROUPS = ((512, 32), (128, 24))  # likewise for each hub among the centres
SHAPE_SCALES = ((1024, 24), (256, 16))  # neighbourhoods whose shape describes a point, besides the finest
FINEST_NEIGHBOURS = (12, 64)  # in the finest: the number for FINE points, which grows with density, and its maximum
LANDMARKS = 64  # points to which distances along the surface are measured
SURFACE_NEIGHBOURS = 8  # along which distances on the surface are measured; the shipped weights depend on it
QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)  # of those distances
INVARIANTS = 4 * (1 + len(SHAPE_SCALES)) + len(QUANTILES) + 1  # numbers that describe a point
UP_NEIGHBOURS = 3  # for interpolation to a finer level


@dataclass(frozen=True)
class CloudGeometry:
    """The network's input for a cloud.

    `points`, `normals` and `invariants` are of the fine level. `groups` are the neighbourhoods of centres among fine
    points, and `hub_groups` those of hubs among centres, as indices. `to_centres` has the hubs nearest to each centre
    and their weights; `to_queries` has the centres nearest to each query. Weights add up to one.
    """

    points: Float32[np.ndarray, "fine 3"]
    normals: Float32[np.ndarray, "fine 3"]
    invariants: Float32[np.ndarray, "fine invariants"]
    groups: tuple[Int64[np.ndarray, "centres k"], ...]
    hub_groups: tuple[Int64[np.ndarray, "hubs k"], ...]
    to_centres: tuple[Int64[np.ndarray, "centres 3"], Float32[np.ndarray, "centres 3"]]
    to_queries: tuple[Int64[np.ndarray, "queries 3"], Float32[np.ndarray, "queries 3"]]
    queries: Float32[np.ndarray, "queries 3"]
    query_invariants: Float32[np.ndarray, "queries invariants"]


def cloud_geometry(points: Float[np.ndarray, "points 3"], all_points: bool = True) -> CloudGeometry:
    """Compute the input for a cloud of at least 8 points. The queries are all of them, or only the fine ones.

    Positions are relative to the cloud's mean, in the unit of `points`.
    """
    points = np.ascontiguousarray(points - points.mean(axis=0), dtype=np.float64)
    fine = _repeated(farthest_points(points, FINE), FINE)
    p_fine = points[fine]
    invariants, normals = _invariants(points, p_fine)
    queries, query_invariants = p_fine, invariants
    if all_points:
        queries = points
        index, weights = _interpolation(p_fine, points)
        query_invariants = np.einsum("qk,qkc->qc", weights, invariants[index])
    return CloudGeometry(
        points=p_fine.astype(np.float32),
        normals=normals.astype(np.float32),
        invariants=invariants.astype(np.float32),
        groups=tuple(_nearest_among(p_fine[:among], p_fine[:CENTRES], k) for among, k in FINE_GROUPS),
        hub_groups=tuple(_nearest_among(p_fine[:among], p_fine[:HUBS], k) for among, k in CENTRE_GROUPS),
        to_centres=_interpolation(p_fine[:HUBS], p_fine[:CENTRES]),
        to_queries=_interpolation(p_fine[:CENTRES], queries),
        queries=queries.astype(np.float32),
        query_invariants=query_invariants.astype(np.float32),
    )


def _repeated(chosen: Int64[np.ndarray, "chosen"], count: int) -> Int64[np.ndarray, "count"]:
    """Repeat the chosen indices until there are `count`."""
    return np.resize(chosen, count)


def _nearest_among(
    points: Float64[np.ndarray, "points 3"], queries: Float64[np.ndarray, "queries 3"], count: int
) -> Int64[np.ndarray, "queries count"]:
    indices = KDTree(np.ascontiguousarray(points)).query(np.ascontiguousarray(queries), k=count)[1]
    return indices.astype(np.int64)


def _interpolation(
    points: Float64[np.ndarray, "points 3"], queries: Float64[np.ndarray, "queries 3"]
) -> tuple[Int64[np.ndarray, "queries 3"], Float32[np.ndarray, "queries 3"]]:
    """The nearest points of each query, and inverse-distance weights."""
    distances, indices = KDTree(np.ascontiguousarray(points)).query(np.ascontiguousarray(queries), k=UP_NEIGHBOURS)
    weights = 1.0 / (distances + 1e-6)
    weights /= weights.sum(axis=1, keepdims=True)
    return indices.astype(np.int64), weights.astype(np.float32)


def _invariants(
    points: Float64[np.ndarray, "points 3"], p_fine: Float64[np.ndarray, "fine 3"]
) -> tuple[Float64[np.ndarray, "fine invariants"], Float64[np.ndarray, "fine 3"]]:
    """The descriptor of each fine point, and its normal (of arbitrary sign)."""
    least, most = FINEST_NEIGHBOURS
    dense = int(np.clip(least * len(points) // FINE, least, most))
    finest, normals = _shape(points, p_fine, min(dense, len(points)))
    shapes = [finest, *(_shape(p_fine[:among], p_fine, k)[0] for among, k in SHAPE_SCALES)]
    return np.concatenate([*shapes, _distances_along(p_fine)], axis=1), normals


def _shape(
    points: Float64[np.ndarray, "points 3"], centres: Float64[np.ndarray, "centres 3"], count: int
) -> tuple[Float64[np.ndarray, "centres 4"], Float64[np.ndarray, "centres 3"]]:
    """Linearity, planarity, roundness and curvature of each centre's neighbourhood, in [0, 1], and its normal."""
    near = points[_nearest_among(points, centres, count)]
    mean = near.mean(axis=1, keepdims=True)
    covariances = np.einsum("nki,nkj->nij", near - mean, near - mean) / count
    values, vectors = np.linalg.eigh(covariances)
    third, second, first = np.sqrt(np.maximum(values, 0)).T
    longest = first + 1e-9
    normals = vectors[:, :, 0]
    bend = np.abs(np.einsum("ni,ni->n", mean[:, 0] - centres, normals)) / longest
    shape = np.stack([(first - second) / longest, (second - third) / longest, third / longest, bend], axis=1)
    return np.minimum(shape, 1.0), normals


def _distances_along(points: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points quantiles_and_mean"]:
    """Quantiles and mean of each point's distances along the surface to the landmarks. The greatest distance is 1."""
    distances = dijkstra(_surface(points), directed=False, indices=np.arange(LANDMARKS))
    distances /= distances.max() + 1e-12
    return np.concatenate([np.quantile(distances, QUANTILES, axis=0), distances.mean(axis=0)[None]]).T


def _surface(points: Float64[np.ndarray, "points 3"]) -> csr_array:
    """The graph of lengths between near points. Each separate piece is linked to its nearest other piece."""
    count = len(points)
    lengths, near = KDTree(points).query(points, k=SURFACE_NEIGHBOURS + 1)
    rows = np.repeat(np.arange(count), SURFACE_NEIGHBOURS)
    columns, lengths = near[:, 1:].ravel().astype(np.int64), lengths[:, 1:].ravel() + 1e-9
    while True:
        graph = csr_array((lengths, (rows, columns)), shape=(count, count))
        pieces, piece = connected_components(graph, directed=False)
        if pieces == 1:
            return graph
        for k in range(pieces):
            inside, outside = np.flatnonzero(piece == k), np.flatnonzero(piece != k)
            gap, there = nearest(KDTree(points[outside]), points[inside])
            closest = gap.argmin()
            rows = np.append(rows, inside[closest])
            columns = np.append(columns, outside[there[closest]])
            lengths = np.append(lengths, gap[closest] + 1e-9)
