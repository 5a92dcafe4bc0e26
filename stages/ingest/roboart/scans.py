"""Scans of an object in several states, as the configuration's sensor makes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from jaxtyping import Float64

from schemas.config import RoboartConfig
from stages.ingest.roboart.articulated import Poses
from stages.ingest.roboart.sensor import (
    Labels,
    Points,
    centre_and_diagonal,
    draw_viewpoints,
    sample_posed,
    sample_visible,
)
from stages.ingest.roboart.surface import Surface
from stages.kernels.motion.rigid_motion import move_points


@dataclass(frozen=True)
class Scan:
    """One frame: points, and the part of each."""

    points: Points
    part: Labels

    def moved(self, T: Float64[np.ndarray, "4 4"]) -> Self:
        """The scan in other coordinates."""
        return replace(self, points=move_points(T, self.points))


def scan_states(surface: Surface, Ts_world_part: Poses, config: RoboartConfig, rng: np.random.Generator) -> list[Scan]:
    """Scan the object in each state independently, in world coordinates."""
    if config.viewpoints:
        size = centre_and_diagonal(surface, Ts_world_part)
        drawn = [
            draw_viewpoints(config.viewpoints, *size, rng)
            for _ in range(config.frames if config.moving_viewpoints else 1)
        ]
        views = drawn if config.moving_viewpoints else drawn * config.frames
        sampled = [
            sample_visible(surface, Ts, p_viewpoints, config.points, rng)
            for Ts, p_viewpoints in zip(Ts_world_part, views, strict=True)
        ]
    else:
        sampled = [sample_posed(surface, Ts, config.points, rng) for Ts in Ts_world_part]
    scans = [Scan(points, part) for points, part in sampled]
    if config.noise_percent:
        noise = config.noise_percent / 100 * centre_and_diagonal(surface, Ts_world_part[:1])[1]
        scans = [replace(scan, points=scan.points + rng.normal(0, noise, scan.points.shape)) for scan in scans]
    return scans
