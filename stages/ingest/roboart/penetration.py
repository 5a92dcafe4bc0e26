"""A cheap score of the penetration of rigid parts, for choosing among poses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float64
from scipy.spatial import ConvexHull, QhullError

from stages.ingest.roboart.surface import Surface, sample_triangles

# number of directions whose extreme points form a part's convex hull
DIRECTIONS = 64
PROBES_PER_PART = 64
# a point counts as inside from this depth on, as a share of the object's diagonal
DEPTH = 0.02

Poses = Float64[np.ndarray, "states parts 4 4"]


def penetration_score(
    surface: Surface, Ts_world_rest: Float64[np.ndarray, "parts 4 4"], rng: np.random.Generator
) -> Callable[[Poses], float]:
    """Make a function that scores poses of the parts. The score is 0 if no two overlap more than at rest.

    For each pair of parts, it takes the share of one part's surface that lies deep inside the other's convex hull. The
    share at rest is subtracted, since an axle in its hub belongs to the design. The score is the sum over pairs in the
    worst state. Hulls are coarse: they rank poses, but do not prove contact.
    """
    triangles = [surface.triangles[surface.part == part] for part in range(len(Ts_world_rest))]
    probes = np.stack([sample_triangles(piece, PROBES_PER_PART, rng)[0] for piece in triangles])
    hulls = [_hull_planes(piece.reshape(-1, 3)) for piece in triangles]
    p_world = _moved(Ts_world_rest[None], probes).reshape(-1, 3)
    depth = DEPTH * float(np.linalg.norm(np.ptp(p_world, axis=0)))
    lows = [piece.min(axis=(0, 1)) + depth for piece in triangles]
    highs = [piece.max(axis=(0, 1)) - depth for piece in triangles]

    def inside(Ts_world_part: Poses) -> Float64[np.ndarray, "states parts parts"]:
        """[s, i, j]: the share of part j's probes that lie deep inside part i."""
        p_world = _moved(Ts_world_part, probes)
        states, parts, count, _ = p_world.shape
        shares = np.empty((states, parts, parts))
        for part, (planes, low, high) in enumerate(zip(hulls, lows, highs, strict=True)):
            T = Ts_world_part[:, part]
            p_part = (p_world.reshape(states, -1, 3) - T[:, None, :3, 3]) @ T[:, :3, :3]
            deep = ((p_part > low) & (p_part < high)).all(axis=-1)  # few points pass, so the planes cost little
            deep[deep] = (p_part[deep] @ planes[:, :3].T + planes[:, 3] <= -depth).all(axis=-1)
            shares[:, part] = deep.reshape(states, parts, count).mean(axis=-1)
            shares[:, part, part] = 0.0
        return shares

    at_rest = inside(Ts_world_rest[None])

    def score(Ts_world_part: Poses) -> float:
        return float(np.clip(inside(Ts_world_part) - at_rest, 0.0, None).sum(axis=(1, 2)).max())

    return score


def _moved(Ts: Poses, points: Float64[np.ndarray, "parts points 3"]) -> Float64[np.ndarray, "states parts points 3"]:
    return points @ np.swapaxes(Ts[..., :3, :3], -1, -2) + Ts[..., None, :3, 3]


def _hull_planes(points: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "planes 4"]:
    """Outward normals and offsets of a coarse convex hull. Inside, normal . p + offset <= 0."""
    extreme = np.unique(np.argmax(_directions(DIRECTIONS) @ points.T, axis=1))
    try:
        return ConvexHull(points[extreme]).equations
    except QhullError:  # nothing lies inside a flat part
        return np.array([[0.0, 0.0, 0.0, np.inf]])


def _directions(count: int) -> Float64[np.ndarray, "directions 3"]:
    """Unit vectors spread evenly over the sphere (Fibonacci's spiral)."""
    index = np.arange(count) + 0.5
    z, turn = 1 - 2 * index / count, np.pi * (1 + np.sqrt(5)) * index
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
