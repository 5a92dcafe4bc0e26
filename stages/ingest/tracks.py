"""Surfaces with known points in every frame, and sampling of frames with ground truth from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from schemas.sequence import PointSequence, TrueSurface
from stages.ingest.dropping import kept_points
from stages.ingest.readers import Frame
from stages.kernels.surfaces.area_sampling import draw_on_triangles

Frames = list[Float64[np.ndarray, "points 3"]]


@dataclass(frozen=True)
class RawSurface:
    """The surface in every frame, in input coordinates, and the places of each frame's points on it.

    Point i of frame t is at the mean of the three vertices `corners[t][i]`, weighted by `weights[t][i]`.
    """

    vertices: Float64[np.ndarray, "frames vertices 3"]
    corners: list[Int64[np.ndarray, "points 3"]]
    weights: list[Float64[np.ndarray, "points 3"]]

    def every(self, step: int) -> RawSurface:
        """The surface of every `step`-th frame, from the first on."""
        return RawSurface(self.vertices[::step], self.corners[::step], self.weights[::step])


def sample_frames(
    vertices: Float64[np.ndarray, "frames vertices 3"],
    triangles: Int64[np.ndarray, "triangles 3"],
    points: int,
    rng: np.random.Generator,
) -> tuple[Frames, RawSurface]:
    """Sample every frame independently and uniformly by area. Return the points and their places on the surface."""
    corners, weights = [], []
    for of_frame in vertices:
        chosen, shares = draw_on_triangles(of_frame[triangles], points, rng)
        corners.append(triangles[chosen])
        weights.append(shares)
    return _sampled(RawSurface(vertices, corners, weights))


def sample_vertices(
    vertices: Float64[np.ndarray, "frames vertices 3"], points: int, rng: np.random.Generator
) -> tuple[Frames, RawSurface]:
    """Draw every frame's points independently from the vertices. If there are too few vertices, take all of them."""
    count = vertices.shape[1]
    chosen = [np.sort(rng.permutation(count)[:points]) for _ in vertices]
    corners = [np.repeat(index[:, None], 3, axis=1) for index in chosen]
    weights = [np.tile([1.0, 0.0, 0.0], (len(index), 1)) for index in chosen]
    return _sampled(RawSurface(vertices, corners, weights))


def _sampled(surface: RawSurface) -> tuple[Frames, RawSurface]:
    of_frames = zip(surface.vertices, surface.corners, surface.weights, strict=True)
    return [np.einsum("nk,nkd->nd", shares, p[corners]) for p, corners, shares in of_frames], surface


def normalise_surface(surface: RawSurface, frames: Sequence[Frame], sequence: PointSequence) -> TrueSurface:
    """Convert the surface of `frames` to the normalised frame of their `sequence`, without dropped points."""
    kept = [kept_points(frame) for frame in frames]
    return TrueSurface(
        vertices=(surface.vertices - np.asarray(sequence.centre)) / sequence.scale,
        corners=np.concatenate([of[mask] for of, mask in zip(surface.corners, kept, strict=True)]).astype(np.int64),
        weights=np.concatenate([of[mask] for of, mask in zip(surface.weights, kept, strict=True)]),
    )
