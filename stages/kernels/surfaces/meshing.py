"""Closed surfaces from points alone: a ball rolled over the cloud, outside and then inside (morphological closing).

Unlike Poisson reconstruction this needs no oriented normals, which scans of parts that are open at their joints do not
yield, and adds no surface farther than the ball's radius from the points. The result is closed by construction: what
the points enclose is solid, and a sheet without a far side becomes a thin slab.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64
from scipy.ndimage import binary_fill_holes, maximum_filter
from scipy.spatial import ConvexHull

from stages.kernels.points.nearest import KDTree, neighbours
from stages.kernels.surfaces.open3d_library import load_open3d

STEPS_PER_RADIUS = 3  # grid steps in the ball's radius; slabs are two steps thick
MOST_NODES = 100_000  # of the grid; a larger thing gets a coarser one


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh; counter-clockwise triangles seen from outside."""

    vertices: Float64[np.ndarray, "vertices 3"]
    triangles: Int64[np.ndarray, "triangles 3"]

    @property
    def closed(self) -> bool:
        """Whether every edge belongs to two triangles that run along it in opposite directions."""
        edges = np.concatenate([self.triangles[:, [0, 1]], self.triangles[:, [1, 2]], self.triangles[:, [2, 0]]])
        codes = np.sort(edges[:, 0] * len(self.vertices) + edges[:, 1])
        reverse = np.sort(edges[:, 1] * len(self.vertices) + edges[:, 0])
        return len(codes) > 0 and bool((np.diff(codes) > 0).all() and (codes == reverse).all())


def closed_surface(points: Float[np.ndarray, "points 3"], radius: float) -> Mesh:
    """The surface that a ball of a radius leaves when rolled over the points from outside; a grid step outside of it.

    `radius` is to exceed half the width of the gaps between samples, and is at least two grid steps.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    step = max(radius / STEPS_PER_RADIUS, float(np.cbrt(np.prod(high - low + 2 * radius) / MOST_NODES)))
    radius = max(radius, 2 * step)
    margin = radius + 2 * step
    origin = low - margin
    shape = tuple(int(n) for n in np.ceil((high - low + 2 * margin) / step).astype(int) + 1)
    cells = np.round((points - origin) / step).astype(int)
    reached = np.zeros(shape, dtype=bool)
    reached[tuple(cells.T)] = True
    near = maximum_filter(reached, size=2 * int(np.ceil(margin / step)) + 1)
    swollen = np.full(shape, -step)
    swollen[near] = radius - KDTree(points).query(origin + step * np.argwhere(near))[0]
    solid = binary_fill_holes(swollen > 0)
    swollen[solid & (swollen <= 0)] = step
    outside = contour(swollen, origin, step).vertices
    depth = radius - step
    shrunk = np.full(shape, -step)
    limit = depth + 2 * step
    distance = KDTree(outside).query(origin + step * np.argwhere(solid), distance_upper_bound=limit)[0]
    shrunk[solid] = np.minimum(distance, limit) - depth
    return contour(shrunk, origin, step)


def contour(field: Float64[np.ndarray, "x y z"], origin: Float64[np.ndarray, "3"], step: float) -> Mesh:
    """The surface where a field on a grid falls from positive, inside, to negative: marching tetrahedra.

    Closed where the field is negative all around the grid's border. Node (i, j, k) lies at origin + step * (i, j, k).
    """
    strides = np.array([field.shape[1] * field.shape[2], field.shape[2], 1])
    inside = field > 0
    corners = [inside[tuple(slice(c, n - 1 + c) for c, n in zip(corner, field.shape, strict=True))] for corner in CUBE]
    count = np.sum(corners, axis=0)
    cells = np.argwhere((count > 0) & (count < 8)) @ strides
    values, crossed = field.ravel(), []
    for tetrahedron in TETRAHEDRA:
        nodes = cells[:, None] + (tetrahedron @ strides)
        case = (values[nodes] > 0) @ np.array([1, 2, 4, 8])
        for number, triangles in enumerate(CASES):
            crossed += [nodes[case == number][:, triangle] for triangle in triangles]
    ends = np.concatenate(crossed) if crossed else np.zeros((0, 3, 2), dtype=np.int64)
    ends = np.sort(ends, axis=-1)
    codes, vertex = np.unique(ends[..., 0] * field.size + ends[..., 1], return_inverse=True)
    a, b = np.divmod(codes, field.size)
    share = np.clip(values[a] / (values[a] - values[b]), 0.02, 0.98)[:, None]  # no triangle shrinks to a point
    p_a, p_b = (np.stack(np.unravel_index(nodes, field.shape), axis=1) for nodes in (a, b))
    return Mesh(origin + step * (p_a + share * (p_b - p_a)), vertex.reshape(-1, 3).astype(np.int64))


def decimated(mesh: Mesh, triangles: int) -> Mesh:
    """About so many triangles by quadric edge collapse; more where fewer would tear a closed mesh open.

    Raises Open3DError where Open3D cannot be loaded.
    """
    while triangles < len(mesh.triangles):
        coarse = _simplified(mesh, triangles)
        if coarse.closed or not mesh.closed:
            return coarse
        triangles *= 2
    return mesh


def _simplified(mesh: Mesh, triangles: int) -> Mesh:
    o3d = load_open3d()
    legacy = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices), o3d.utility.Vector3iVector(mesh.triangles.astype(np.int32))
    )
    coarse = legacy.simplify_quadric_decimation(triangles).remove_unreferenced_vertices()
    return Mesh(np.asarray(coarse.vertices).copy(), np.asarray(coarse.triangles).astype(np.int64))


def convex_hull(points: Float[np.ndarray, "points 3"]) -> Mesh:
    """The convex hull. Raises scipy's QhullError for points in a plane."""
    hull = ConvexHull(points)
    used, triangles = np.unique(hull.simplices, return_inverse=True)
    vertices, triangles = points[used].astype(np.float64), triangles.reshape(-1, 3).astype(np.int64)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    inward = np.einsum("ni,ni->n", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return Mesh(vertices, triangles)


def without_outliers(points: Float64[np.ndarray, "points 3"], count: int = 8) -> Bool[np.ndarray, "points"]:
    """Which points are not far from their neighbours: at most three times as far as is usual in their cloud."""
    if len(points) <= count:
        return np.ones(len(points), dtype=bool)
    distance = neighbours(points, count)[0].mean(axis=1)
    return distance <= 3 * np.median(distance)


def smoothed(points: Float64[np.ndarray, "points 3"], count: int = 12) -> Float64[np.ndarray, "points 3"]:
    """Each point moved to the plane through its neighbours, itself among them, which evens out noise across a surface.

    Points with fewer than `count` others stay where they are.
    """
    if len(points) <= count:
        return points
    near = np.concatenate([points[:, None], points[neighbours(points, count)[1]]], axis=1)
    centre = near.mean(axis=1)
    offsets = near - centre[:, None]
    normal = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))[1][:, :, 0]
    return points - np.einsum("ni,ni->n", points - centre, normal)[:, None] * normal


def _tetrahedra() -> Int64[np.ndarray, "6 4 3"]:
    """The six tetrahedra around a cube's diagonal (Kuhn), right-handed, whose faces fit those of the next cube."""
    paths = []
    for order in permutations(range(3)):
        path = np.cumsum(np.concatenate([np.zeros((1, 3), dtype=np.int64), np.eye(3, dtype=np.int64)[list(order)]]), 0)
        paths.append(path if np.linalg.det(path[1:]) > 0 else path[[0, 2, 1, 3]])
    return np.stack(paths)


def _cases() -> list[list[Int64[np.ndarray, "3 2"]]]:
    """For each set of corners inside (bit i: corner i) the triangles between it and the rest: three edges each."""
    corners = TETRAHEDRA[0].astype(np.float64)
    cases = []
    for number in range(16):
        within = [corner for corner in range(4) if number >> corner & 1]
        beyond = [corner for corner in range(4) if not number >> corner & 1]
        edges = [(a, b) for a in within for b in beyond]
        faces = [[0, 1, 2]] if len(edges) == 3 else [[0, 1, 3], [0, 3, 2]] if len(edges) == 4 else []
        triangles = []
        for face in faces:
            triangle = np.array([edges[i] for i in face])
            p = corners[triangle].mean(axis=1)
            out = corners[beyond].mean(axis=0) - corners[within].mean(axis=0)
            flipped = np.cross(p[1] - p[0], p[2] - p[0]) @ out < 0
            triangles.append(triangle[::-1] if flipped else triangle)
        cases.append(triangles)
    return cases


CUBE = list(product((0, 1), repeat=3))
TETRAHEDRA = _tetrahedra()
CASES = _cases()
