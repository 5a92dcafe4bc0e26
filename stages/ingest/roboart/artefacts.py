"""Faults of scans beyond noise: stray points, a piece of the table below, uneven density, and holes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, Int64

from schemas.config import ArtefactsConfig
from schemas.sequence import NO_PART
from stages.ingest.roboart.mesh_reading import Triangles
from stages.ingest.roboart.sensor import Labels, Points

# stray points lie in the object's bounding box and beyond it by this share of its sides
SURROUNDINGS = 0.2
# the density is a sum of so many waves, whose lengths are between these, in diagonals
WAVES = 6
WAVE_LENGTHS = (0.4, 1.2)
# holes are smaller than the greatest radius by at most this factor
LEAST_HOLE = 0.5
TABLE_CORNERS = 48


def with_outliers(points: Points, labels: Labels, share: float, rng: np.random.Generator) -> tuple[Points, Labels]:
    """Put a share of the points anywhere in and around the bounding box. They belong to no part."""
    stray = rng.random(len(points)) < share
    low, high = points.min(axis=0), points.max(axis=0)
    margin = SURROUNDINGS * (high - low)
    anywhere = rng.uniform(low - margin, high + margin, points.shape)
    return np.where(stray[:, None], anywhere, points), np.where(stray, NO_PART, labels)


def thinned_unevenly(
    points: Points, count: int, config: ArtefactsConfig, diagonal: float, rng: np.random.Generator
) -> Int64[np.ndarray, "chosen"]:
    """Indices of at most `count` points outside of holes, more of them where the density is high."""
    kept = np.flatnonzero(_outside_holes(points, config, diagonal, rng))
    density = np.exp(config.density_spread * _smooth_field(points[kept], diagonal, rng))
    count = min(count, len(kept))
    return np.sort(rng.choice(kept, count, replace=False, p=density / density.sum()))


def table_below(centre: Float64[np.ndarray, "3"], lowest: float, diameter: float) -> Triangles:
    """A level disc below the centre, at the height `lowest`."""
    angle = 2 * np.pi * np.arange(TABLE_CORNERS + 1) / TABLE_CORNERS
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1) * diameter / 2
    middle = np.array([centre[0], centre[1], lowest])
    return middle + np.stack([np.zeros_like(rim[1:]), rim[:-1], rim[1:]], axis=1)


def _outside_holes(
    points: Points, config: ArtefactsConfig, diagonal: float, rng: np.random.Generator
) -> Bool[np.ndarray, "points"]:
    kept = np.ones(len(points), dtype=bool)
    for _ in range(config.holes):
        radius = config.hole_radius * diagonal * rng.uniform(LEAST_HOLE, 1)
        kept &= np.linalg.norm(points - points[rng.integers(len(points))], axis=1) > radius
    return kept


def _smooth_field(points: Points, diagonal: float, rng: np.random.Generator) -> Float64[np.ndarray, "points"]:
    """A random smooth field of mean 0 and variance 1 over space, at the points."""
    directions = rng.normal(size=(WAVES, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lengths = diagonal * rng.uniform(*WAVE_LENGTHS, WAVES)
    phases = 2 * np.pi * (points @ directions.T / lengths + rng.random(WAVES))
    return np.sqrt(2 / WAVES) * np.cos(phases).sum(axis=1)
