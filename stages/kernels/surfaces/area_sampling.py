"""Sampling of points on triangles, uniformly by area."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64

Triangles = Float64[np.ndarray, "triangles 3 3"]


def sample_triangles(
    triangles: Triangles, count: int, rng: np.random.Generator
) -> tuple[Float64[np.ndarray, "points 3"], Int64[np.ndarray, "points"]]:
    """Sample points uniformly by area, with the triangle of each."""
    chosen, weights = draw_on_triangles(triangles, count, rng)
    return on_triangles(triangles[chosen], weights), chosen


def draw_on_triangles(
    triangles: Triangles, count: int, rng: np.random.Generator
) -> tuple[Int64[np.ndarray, "points"], Float64[np.ndarray, "points 3"]]:
    """Draw places uniformly by area: the triangle of each, and the weights of its corners."""
    cumulative = np.cumsum(areas(triangles))
    chosen = np.searchsorted(cumulative[:-1], rng.uniform(0, cumulative[-1], count), side="right")
    # the root makes the image of the unit square uniform over the triangle
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    return chosen, np.stack([1 - u, u * (1 - v), u * v], axis=1)


def on_triangles(
    corners: Float64[np.ndarray, "points 3 values"], weights: Float64[np.ndarray, "points 3"]
) -> Float64[np.ndarray, "points values"]:
    """The weighted mean of what each point's triangle has at its three corners."""
    (a, b, c), (of_a, of_b, of_c) = np.moveaxis(corners, 1, 0), weights.T[..., None]
    mean: Float64[np.ndarray, "points values"] = of_a * a + of_b * b + of_c * c
    return mean


def areas(triangles: Triangles) -> Float64[np.ndarray, "triangles"]:
    """The area of each triangle."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
