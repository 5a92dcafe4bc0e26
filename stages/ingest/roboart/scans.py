"""Scans of an object in several states, as the configuration's sensor makes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from jaxtyping import Float64

from schemas.config import RoboartConfig
from schemas.sequence import NO_PART
from stages.ingest.roboart.artefacts import table_below, thinned_unevenly, with_outliers
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
# where scans are uneven, so many times the points are sampled first
OVERSAMPLING = 4

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


@dataclass(frozen=True)
class Scene:
    """An object's surface, posed in every frame."""

    surface: Surface
    Ts_world_part: Poses

    @cached_property
    def size(self) -> tuple[Float64[np.ndarray, "3"], float]:
        """The centre and diagonal of the bounding box over all frames."""
        return centre_and_diagonal(self.surface, self.Ts_world_part)

    @cached_property
    def diagonal(self) -> float:
        """The diagonal of the bounding box in the first frame."""
        return centre_and_diagonal(self.surface, self.Ts_world_part[:1])[1]

    def on_table(self, diameter: float) -> Self:
        """The same with a piece of the table that it stands on, of a diameter in diagonals, as one more part."""
        (centre, diagonal), surface = self.size, self.surface
        lowest = min(float(posed_triangles(surface, Ts)[..., 2].min()) for Ts in self.Ts_world_part)
        table = table_below(centre, lowest, diameter * diagonal)
        frames, parts = self.Ts_world_part.shape[:2]
        return replace(
            self,
            surface=Surface(
                np.concatenate([surface.triangles, table]), np.concatenate([surface.part, np.full(len(table), parts)])
            ),
            Ts_world_part=np.concatenate([self.Ts_world_part, np.tile(np.eye(4), (frames, 1, 1, 1))], axis=1),
        )


def scan_states(surface: Surface, Ts_world_part: Poses, config: RoboartConfig, rng: np.random.Generator) -> list[Scan]:
    """Scan the object in each state independently, in world coordinates."""
    scene = Scene(surface, Ts_world_part)
    views = _viewpoints(scene, config, rng)
    on_table = scene.on_table(config.artefacts.table_size) if config.artefacts.table_size else scene
    scans = [_scan(scene, on_table, t, view, config, rng) for t, view in enumerate(views)]
    if config.noise_percent and not config.depth.cameras:
        noise = config.noise_percent / 100 * scene.diagonal
        scans = [replace(scan, points=scan.points + rng.normal(0, noise, scan.points.shape)) for scan in scans]
    if share := config.artefacts.outlier_share:
        scans = [Scan(*with_outliers(scan.points, scan.part, share, rng), scan.p_viewpoints) for scan in scans]
    return scans


def _scan(
    scene: Scene, on_table: Scene, t: int, view: Viewpoints | None, config: RoboartConfig, rng: np.random.Generator
) -> Scan:
    """One frame: what the sensor sees of the object on the table, thinned where scans are uneven."""
    uneven = config.artefacts.density_spread > 0 or config.artefacts.holes > 0
    count = OVERSAMPLING * config.points if uneven else config.points
    surface, Ts = on_table.surface, on_table.Ts_world_part[t]
    if view is None:
        points, part = sample_posed(surface, Ts, count, rng)
    elif config.depth.cameras:
        sensor = DepthSensor(config.depth, *scene.size, config.noise_percent / 100 * scene.diagonal)
        points, part = scan_depth(surface, Ts, view, sensor, count, rng)
    else:
        points, part = sample_visible(surface, Ts, view, count, rng)
    part = np.where(part < scene.Ts_world_part.shape[1], part, NO_PART)
    if uneven:
        chosen = thinned_unevenly(points, config.points, config.artefacts, scene.diagonal, rng)
        points, part = points[chosen], part[chosen]
    return Scan(points, part, view)


def _viewpoints(scene: Scene, config: RoboartConfig, rng: np.random.Generator) -> list[Viewpoints | None]:
    """Where the sensors stand in each frame, in the world; None where they see all around."""
    count, frames = config.depth.cameras or config.viewpoints, len(scene.Ts_world_part)
    if not count:
        return [None] * frames
    distance = config.depth.distance if config.depth.cameras else DISTANCE

    def draw() -> Viewpoints:
        return draw_viewpoints(count, *scene.size, rng, distance)

    if config.moving_viewpoints:
        return [draw() for _ in range(frames)]
    if config.depth.cameras:
        return [_best_placement(scene, [draw() for _ in range(PLACEMENTS)], rng)] * frames
    return [draw()] * frames


def _best_placement(scene: Scene, placements: list[Viewpoints], rng: np.random.Generator) -> Viewpoints:
    """The placement of cameras that sees the largest share of each part's surface, in the mean over parts and states.

    The first, the middle and the last state count.
    """
    surface, Ts_world_part = scene.surface, scene.Ts_world_part
    parts = np.unique(surface.part)
    probes = [sample_triangles(surface.triangles[surface.part == part], PROBES_PER_PART, rng)[0] for part in parts]
    p_all = np.concatenate(placements)
    shares = np.zeros(len(placements))
    for Ts in Ts_world_part[[0, len(Ts_world_part) // 2, -1]]:
        p_world = np.concatenate([move_points(Ts[part], probe) for part, probe in zip(parts, probes, strict=True)])
        sees = line_of_sight(posed_triangles(surface, Ts), p_all)(p_world)
        shares += sees.reshape(len(placements), -1, len(p_world)).any(axis=1).mean(axis=1)
    return placements[int(shares.argmax())]
