"""Clouds of pinhole depth cameras: pixels with the faults of depth, put back into the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from schemas.config import DepthConfig
from schemas.sequence import NO_PART
from stages.ingest.roboart.sensor import Labels, Points, Poses, Raycaster, posed_triangles, raycaster
from stages.ingest.roboart.surface import Surface
from stages.support.open3d_use import needing_open3d

Depth = Float64[np.ndarray, "rows columns"]

# a pixel lies at an edge where what a neighbour shows is farther away by so many diagonals, or nothing
EDGE = 0.02
# a flying pixel lies at most so many diagonals behind its edge
FLIGHT = 0.1


@dataclass(frozen=True)
class DepthSensor:
    """Depth cameras that look at the point `p_target` in the world, with z up.

    `noise` is the standard deviation of the depth there; both lengths are in the world's unit.
    """

    config: DepthConfig
    p_target: Float64[np.ndarray, "3"]
    diagonal: float
    noise: float


@needing_open3d("roboart.depth")
def scan_depth(
    surface: Surface,
    Ts_world_part: Poses,
    p_cameras: Float64[np.ndarray, "cameras 3"],
    sensor: DepthSensor,
    count: int,
    rng: np.random.Generator,
) -> tuple[Points, Labels]:
    """Points in the world of all cameras together, with the part of each; `NO_PART` of flying pixels.

    Of more than `count` points a random choice is returned, which keeps the sensor's own density and its share of
    flying pixels: farthest points would take nearly all of these. There may be fewer.
    """
    cast = raycaster(posed_triangles(surface, Ts_world_part))
    clouds = [_cloud(cast, surface.part, eye, sensor, rng) for eye in p_cameras]
    points, labels = (np.concatenate(pieces) for pieces in zip(*clouds, strict=True))
    chosen = np.sort(rng.permutation(len(points))[:count])
    return points[chosen], labels[chosen]


def _cloud(
    cast: Raycaster,
    part: Int64[np.ndarray, "triangles"],
    eye: Float64[np.ndarray, "3"],
    sensor: DepthSensor,
    rng: np.random.Generator,
) -> tuple[Points, Labels]:
    """The points of one camera: depths, moved by what flies, by noise and by quantisation, along their rays."""
    config, usual = sensor.config, float(np.linalg.norm(sensor.p_target - eye))
    rays = pixel_rays(eye, sensor.p_target, config)
    hits = cast(np.broadcast_to(eye, rays.shape), rays)
    depth = hits["t_hit"].astype(np.float64)
    cosine = np.abs((hits["primitive_normals"] * rays).sum(axis=-1)) / np.linalg.norm(rays, axis=-1)
    returned = np.isfinite(depth) & (cosine > np.cos(np.radians(config.grazing_degrees)))
    behind = behind_edges(depth, sensor.diagonal)
    flies = returned & (behind > 0) & (rng.random(depth.shape) < config.flying_share)
    labels = part[np.where(returned, hits["primitive_ids"], 0)]
    labels[flies] = NO_PART
    depth[flies] += (behind * rng.random(depth.shape))[flies]
    seen = depth[returned]
    seen += sensor.noise * (seen / usual) ** 2 * rng.normal(size=seen.shape)
    seen = quantised(seen, config.quantisation_percent / 100 * sensor.diagonal, usual)
    return eye + seen[:, None] * rays[returned], labels[returned]


def pixel_rays(
    eye: Float64[np.ndarray, "3"], p_target: Float64[np.ndarray, "3"], config: DepthConfig
) -> Float64[np.ndarray, "rows columns 3"]:
    """The direction in the world of each pixel's ray, which has length one along the line of sight."""
    forward = (p_target - eye) / np.linalg.norm(p_target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right)
    down = np.cross(forward, right)
    focal = config.width / 2 / np.tan(np.radians(config.field_of_view_degrees) / 2)
    u = (np.arange(config.width) + 0.5 - config.width / 2) / focal
    v = (np.arange(config.height) + 0.5 - config.height / 2) / focal
    return forward + u[None, :, None] * right + v[:, None, None] * down


def behind_edges(depth: Depth, diagonal: float) -> Depth:
    """How far behind each pixel at a depth edge a point in the air may lie; 0 elsewhere.

    `depth` is infinite where nothing is seen.
    """
    padded = np.pad(depth, 1, mode="edge")
    neighbours = (padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:])
    seen = np.where(np.isfinite(depth), depth, 0.0)
    gap = np.max(neighbours, axis=0) - seen
    return np.where((gap > EDGE * diagonal) & np.isfinite(depth), np.minimum(gap, FLIGHT * diagonal), 0.0)


def quantised(depth: Float64[np.ndarray, "pixels"], step: float, usual: float) -> Float64[np.ndarray, "pixels"]:
    """Round depths as a disparity is rounded: in steps of their inverse, which are `step` at the depth `usual`."""
    if step == 0:
        return depth
    of_inverse = step / usual**2
    return 1 / (np.maximum(np.round(1 / (depth * of_inverse)), 1) * of_inverse)
