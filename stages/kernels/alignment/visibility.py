"""What cameras can see: places behind a surface that they saw are hidden, and say nothing for or against a pose.

Places in front of what was seen are free space, and so are directions in which nothing was seen: a point there would
have been seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Bool, Float64

from stages.kernels.points.nearest import KDTree, nearest

BESIDE = 1.5  # spacings across the line of sight within which a seen point hides what lies behind it
BEHIND = 3.0  # spacings along the line of sight from which on a place is hidden
UNSEEN_COST, UNSEEN_FRAMES = 4.0, 3.0  # what a place costs before any frame shows it, and frames that this is worth


@dataclass(frozen=True)
class View:
    """What the cameras of one frame saw: for each its place, and the seen points by direction and depth."""

    p_cameras: Float64[np.ndarray, "cameras 3"]
    directions: tuple[KDTree, ...]
    depths: Float64[np.ndarray, "cameras seen"]
    spacing: float

    @classmethod
    def of(
        cls, p_seen: Float64[np.ndarray, "seen 3"], p_cameras: Float64[np.ndarray, "cameras 3"], spacing: float
    ) -> Self:
        """The view of some points, which all cameras together saw, from the cameras' places."""
        rays, depths = _rays(p_seen, p_cameras)
        return cls(p_cameras, tuple(KDTree(np.ascontiguousarray(of_camera)) for of_camera in rays), depths, spacing)

    def hides(self, p: Float64[np.ndarray, "points 3"]) -> Bool[np.ndarray, "points"]:
        """Which places lie behind seen surfaces for every camera."""
        hidden = np.ones(len(p), dtype=bool)
        if len(p) == 0:
            return hidden
        for tree, seen, p_camera in zip(self.directions, self.depths, self.p_cameras, strict=True):
            rays, depths = _rays(p, p_camera[None])
            angle, index = nearest(tree, rays[0])
            beside = angle * seen[index] < BESIDE * self.spacing
            hidden &= beside & (depths[0] > seen[index] + BEHIND * self.spacing)
        return hidden


def _rays(
    p: Float64[np.ndarray, "points 3"], p_cameras: Float64[np.ndarray, "cameras 3"]
) -> tuple[Float64[np.ndarray, "cameras points 3"], Float64[np.ndarray, "cameras points"]]:
    """Unit directions from each camera to each point, and their distances."""
    offsets = p - p_cameras[:, None]
    depths = np.linalg.norm(offsets, axis=-1)
    return offsets / np.maximum(depths, 1e-12)[..., None], depths


def sum_of_seen(
    costs: Float64[np.ndarray, "*shape"], hidden: Bool[np.ndarray, "*shape"], frames_axis: int
) -> Float64[np.ndarray, "entries"]:
    """The sum over frames of what each entry costs; in frames that hide it, what the other frames let one expect.

    That is the mean of the frames that show it and of `UNSEEN_FRAMES` more at `UNSEEN_COST`: to be hidden is no way to
    be cheap.
    """
    seen = (costs * ~hidden).sum(axis=frames_axis)
    unseen = hidden.sum(axis=frames_axis)
    shown = costs.shape[frames_axis] - unseen
    return np.asarray(seen + unseen * (seen + UNSEEN_FRAMES * UNSEEN_COST) / (shown + UNSEEN_FRAMES))
