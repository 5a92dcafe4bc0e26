"""Samples of a posed surface: points on all of it or on its visible portion, and the rays that tell what that is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float64, Int64

from stages.ingest.roboart.mesh_reading import Triangles
from stages.ingest.roboart.surface import Surface, sample_triangles
from stages.kernels.surfaces.open3d_library import load_open3d
from stages.support.open3d_use import needing_open3d

Points = Float64[np.ndarray, "points 3"]
Labels = Int64[np.ndarray, "points"]
Poses = Float64[np.ndarray, "parts 4 4"]
Raycaster = Callable[[np.ndarray, np.ndarray], dict[str, np.ndarray]]

# viewpoints surround the object at this distance from its centre, in diagonals, level with it or above
DISTANCE = 1.5
ELEVATION_DEGREES = (0.0, 50.0)
# a point is visible unless something is nearer along its ray by more than this share of the distance (in float32)
SLACK = 5e-5


def sample_posed(surface: Surface, Ts_world_part: Poses, count: int, rng: np.random.Generator) -> tuple[Points, Labels]:
    """Sample world points uniformly by area on the posed surface, with the part of each."""
    p_part, chosen = sample_triangles(surface.triangles, count, rng)
    part = surface.part[chosen]
    return (Ts_world_part[part, :3, :3] @ p_part[:, :, None])[..., 0] + Ts_world_part[part, :3, 3], part


def sample_visible(
    surface: Surface,
    Ts_world_part: Poses,
    p_viewpoints: Float64[np.ndarray, "viewpoints 3"],
    count: int,
    rng: np.random.Generator,
) -> tuple[Points, Labels]:
    """Sample as `sample_posed` does, but only where at least one of the viewpoints sees the surface."""
    sees = line_of_sight(posed_triangles(surface, Ts_world_part), p_viewpoints)
    points, labels = np.empty((0, 3)), np.empty(0, dtype=np.int64)
    while len(points) < count:  # this ends, since some of the surface is always visible from outside
        p_world, part = sample_posed(surface, Ts_world_part, 2 * count, rng)
        seen = sees(p_world).any(axis=0)
        points, labels = np.concatenate([points, p_world[seen]]), np.concatenate([labels, part[seen]])
    return points[:count], labels[:count]


def draw_viewpoints(
    count: int,
    centre: Float64[np.ndarray, "3"],
    diagonal: float,
    rng: np.random.Generator,
    distance: float = DISTANCE,
) -> Float64[np.ndarray, "viewpoints 3"]:
    """Draw positions of sensors: at even angles around the object (z is up), with random turn and elevations.

    `distance` is that from the centre, in diagonals.
    """
    azimuth = 2 * np.pi * (rng.random() + np.arange(count) / count)
    elevation = np.radians(rng.uniform(*ELEVATION_DEGREES, count))
    level = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)], axis=1)
    directions = np.cos(elevation)[:, None] * level + np.sin(elevation)[:, None] * [0.0, 0.0, 1.0]
    return centre + distance * diagonal * directions


def posed_triangles(surface: Surface, Ts_world_part: Poses) -> Float64[np.ndarray, "triangles 3 3"]:
    """The surface's triangles, posed with their parts."""
    Ts = Ts_world_part[surface.part]
    return surface.triangles @ np.swapaxes(Ts[:, :3, :3], -1, -2) + Ts[:, None, :3, 3]


def centre_and_diagonal(
    surface: Surface, Ts_world_part: Float64[np.ndarray, "states parts 4 4"]
) -> tuple[Float64[np.ndarray, "3"], float]:
    """The centre and diagonal of the bounding box of the surface over all given states."""
    posed = [posed_triangles(surface, Ts).reshape(-1, 3) for Ts in Ts_world_part]
    low = np.min([corners.min(axis=0) for corners in posed], axis=0)
    high = np.max([corners.max(axis=0) for corners in posed], axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low))


@needing_open3d("roboart.viewpoints")
def line_of_sight(
    triangles: Triangles, p_viewpoints: Float64[np.ndarray, "viewpoints 3"]
) -> Callable[[Points], Bool[np.ndarray, "viewpoints points"]]:
    """Make a function that finds which points each viewpoint sees past the triangles."""
    cast = raycaster(triangles)

    def sees(points: Points) -> Bool[np.ndarray, "viewpoints points"]:
        p_from = np.broadcast_to(p_viewpoints[:, None], (len(p_viewpoints), len(points), 3))
        hits = cast(p_from, points - p_from)["t_hit"]  # a ray reaches its point at 1
        seen: Bool[np.ndarray, "viewpoints points"] = hits >= 1 - SLACK
        return seen

    return sees


def raycaster(triangles: Triangles) -> Raycaster:
    """Make a function that casts rays, from origins (*, 3) along directions (*, 3), at triangles.

    Its arrays `t_hit` (infinite without a hit), `primitive_ids` and `primitive_normals` are Open3D's. Raises
    Open3DError.
    """
    open3d = load_open3d()
    tensor = open3d.core.Tensor.from_numpy
    corners = np.arange(3 * len(triangles), dtype=np.uint32).reshape(-1, 3)
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(tensor(triangles.reshape(-1, 3).astype(np.float32)), tensor(corners))

    def cast(origins: np.ndarray, directions: np.ndarray) -> dict[str, np.ndarray]:
        rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
        return {name: found.numpy() for name, found in scene.cast_rays(tensor(rays), nthreads=1).items()}

    return cast
