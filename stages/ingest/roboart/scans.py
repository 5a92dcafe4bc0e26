"""Scans of an object in several states, as the configuration's sensor makes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from jaxtyping import Float64

from schemas.config import RoboartConfig
from stages.ingest.roboart.articulated import Poses
from stages.ingest.roboart.depth_camera import DepthSensor, scan_depth
from stages.ingest.roboart.sensor import (
    DISTANCE,
    Labels,
    Points,
    centre_and_diagonal,
    draw_viewpoints,
    line_of_sight,
    posed_triangles,
    sample_posed,
    sample_visible,
)
from stages.ingest.roboart.surface import Surface, sample_triangles
from stages.kernels.motion.rigid_motion import move_points

# depth cameras that stand still are placed well: of so many placements, that which sees most of the parts
PLACEMENTS = 8
PROBES_PER_PART = 64

Viewpoints = Float64[np.ndarray, "cameras 3"]


@dataclass(frozen=True)
class Scan:
    """One frame: points, the part of each (`NO_PART` of stray ones), and where sensors stood; None: all around."""

    points: Points
    part: Labels
    p_viewpoints: Viewpoints | None = None

    def moved(self, T: Float64[np.ndarray, "4 4"]) -> Self:
        """The scan in other coordinates."""
        p_viewpoints = None if self.p_viewpoints is None else move_points(T, self.p_viewpoints)
        return replace(self, points=move_points(T, self.points), p_viewpoints=p_viewpoints)


def scan_states(surface: Surface, Ts_world_part: Poses, config: RoboartConfig, rng: np.random.Generator) -> list[Scan]:
    """Scan the object in each state independently, in world coordinates."""
    views = _viewpoints(surface, Ts_world_part, config, rng)
    noise = 0.0
    if config.noise_percent:
        noise = config.noise_percent / 100 * centre_and_diagonal(surface, Ts_world_part[:1])[1]
    if config.depth.cameras:
        sensor = DepthSensor(config.depth, *centre_and_diagonal(surface, Ts_world_part), noise)
        return [
            Scan(*scan_depth(surface, Ts, view, sensor, config.points, rng), view)
            for Ts, view in zip(Ts_world_part, views, strict=True)
            if view is not None
        ]
    scans = [
        Scan(*sample_posed(surface, Ts, config.points, rng), view)
        if view is None
        else Scan(*sample_visible(surface, Ts, view, config.points, rng), view)
        for Ts, view in zip(Ts_world_part, views, strict=True)
    ]
    if noise:
        scans = [replace(scan, points=scan.points + rng.normal(0, noise, scan.points.shape)) for scan in scans]
    return scans


def _viewpoints(
    surface: Surface, Ts_world_part: Poses, config: RoboartConfig, rng: np.random.Generator
) -> list[Viewpoints | None]:
    """Where the sensors stand in each frame, in the world; None where they see all around."""
    count, frames = config.depth.cameras or config.viewpoints, len(Ts_world_part)
    if not count:
        return [None] * frames
    size = centre_and_diagonal(surface, Ts_world_part)
    distance = config.depth.distance if config.depth.cameras else DISTANCE

    def draw() -> Viewpoints:
        return draw_viewpoints(count, *size, rng, distance)

    if config.moving_viewpoints:
        return [draw() for _ in range(frames)]
    if config.depth.cameras:
        return [_best_placement(surface, Ts_world_part, [draw() for _ in range(PLACEMENTS)], rng)] * frames
    return [draw()] * frames


def _best_placement(
    surface: Surface, Ts_world_part: Poses, placements: list[Viewpoints], rng: np.random.Generator
) -> Viewpoints:
    """The placement of cameras that sees the largest share of each part's surface, in the mean over parts and states.

    The first, the middle and the last state count.
    """
    parts = np.unique(surface.part)
    probes = [sample_triangles(surface.triangles[surface.part == part], PROBES_PER_PART, rng)[0] for part in parts]
    p_all = np.concatenate(placements)
    shares = np.zeros(len(placements))
    for Ts in Ts_world_part[[0, len(Ts_world_part) // 2, -1]]:
        p_world = np.concatenate([move_points(Ts[part], probe) for part, probe in zip(parts, probes, strict=True)])
        sees = line_of_sight(posed_triangles(surface, Ts), p_all)(p_world)
        shares += sees.reshape(len(placements), -1, len(p_world)).any(axis=1).mean(axis=1)
    return placements[int(shares.argmax())]
