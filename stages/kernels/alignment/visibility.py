"""What was seen of a place in a frame: where nothing could be seen, that no point lies there says nothing.

Where the cameras' places are known (`View`), places behind a surface that they saw are hidden. Places in front of what
was seen are free space, and so are directions in which nothing was seen: a point there would have been seen. Where they
are not known (`Exposure`), a place that the points around it leave few lines of sight is likely not to have been seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Self

import numpy as np
from jaxtyping import Bool, Float64, Int64

from stages.kernels.points.nearest import KDTree, nearest

BESIDE = 1.5  # spacings across the line of sight within which a seen point hides what lies behind it
BEHIND = 3.0  # spacings along the line of sight from which on a place is hidden
EDGE_ON = np.cos(np.radians(80.0))  # cosine of the angle from which on a camera hardly sees a surface
UNSEEN_COST, UNSEEN_FRAMES = 4.0, 3.0  # what a place costs before any frame shows it, and frames that this is worth
CELL = 4.0  # of the grid of exposures, in spacings: hardly a cell of a sampled surface is empty
MOST_CELLS = 100  # of that grid along an axis, however close most points lie
DIRECTIONS = np.array([step for step in product((-1, 0, 1), repeat=3) if any(step)])
WALL, OPEN = 0.35, 0.65  # exposure of a place within a flat wall, whose outer side is open, and of one seen for sure
LEAST = 0.1  # what emptiness says of a place that is as closed as one within a wall


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

    def tells(self, p: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points"]:
        """How much it says of places that no point lies there: nothing where every camera's view is blocked."""
        return 1.0 - self.hides(p)

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

    def outward(
        self, p: Float64[np.ndarray, "points 3"], normals: Float64[np.ndarray, "points 3"]
    ) -> Float64[np.ndarray, "points 3"]:
        """Normals of seen surfaces, turned to the side of the camera that they face most."""
        cosines = self._cosines(p, normals)
        most = cosines[np.abs(cosines).argmax(axis=0), np.arange(len(p))]
        return np.where(most[:, None] < 0, -normals, normals)

    def faces(
        self, p: Float64[np.ndarray, "points 3"], outward: Float64[np.ndarray, "points 3"]
    ) -> Bool[np.ndarray, "points"]:
        """Which surfaces some camera could see at all: neither from behind nor edge on."""
        return (self._cosines(p, outward) > EDGE_ON).any(axis=0)

    def _cosines(
        self, p: Float64[np.ndarray, "points 3"], normals: Float64[np.ndarray, "points 3"]
    ) -> Float64[np.ndarray, "cameras points"]:
        """The cosine of the angle between each normal and the direction to each camera."""
        return -np.einsum("cpi,pi->cp", _rays(p, self.p_cameras)[0], normals)


@dataclass(frozen=True)
class Exposure:
    """How open the places of one frame are: the share of directions in which none of its points lies, on a grid."""

    p_low: Float64[np.ndarray, "3"]
    cell: float
    exposure: Float64[np.ndarray, "x y z"]

    @classmethod
    def of(cls, p_seen: Float64[np.ndarray, "seen 3"], spacing: float) -> Self:
        """The exposure around some points, along the grid's 26 directions, from the next cell but one on."""
        cell = max(CELL * spacing, np.ptp(p_seen, axis=0).max() / MOST_CELLS)
        p_low = p_seen.min(axis=0) - 2 * cell
        shape = np.ceil((p_seen.max(axis=0) - p_low) / cell).astype(np.int64) + 2
        occupied = np.zeros(shape, dtype=bool)
        occupied[tuple(((p_seen - p_low) / cell).astype(np.int64).T)] = True
        closed = np.zeros(shape)
        for direction in DIRECTIONS:
            blocked, reach = _ahead(occupied, 2 * direction), 1
            while reach < max(shape):
                blocked, reach = blocked | _ahead(blocked, reach * direction), 2 * reach
            closed += blocked
        return cls(p_low, cell, 1.0 - closed / len(DIRECTIONS))

    def at(self, p: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points"]:
        """The exposure of places: one outside the grid."""
        index = np.floor((p - self.p_low) / self.cell).astype(np.int64)
        inside = ((index >= 0) & (index < self.exposure.shape)).all(axis=1)
        exposure = np.ones(len(p))
        exposure[inside] = self.exposure[tuple(index[inside].T)]
        return exposure

    def tells(self, p: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points"]:
        """How much it says of places that no point lies there: from `LEAST` within a wall to one in the open."""
        return np.clip((self.at(p) - WALL) / (OPEN - WALL), LEAST, 1.0)


def _ahead(grid: Bool[np.ndarray, "x y z"], steps: Int64[np.ndarray, "3"]) -> Bool[np.ndarray, "x y z"]:
    """What the grid holds so many cells ahead of each cell: nothing beyond its end."""
    ahead = np.zeros_like(grid)
    if (np.abs(steps) < grid.shape).all():
        ahead[_overlap(-steps, grid.shape)] = grid[_overlap(steps, grid.shape)]
    return ahead


def _overlap(steps: Int64[np.ndarray, "3"], shape: tuple[int, ...]) -> tuple[slice, ...]:
    """Where a grid that is moved by some steps overlaps itself."""
    return tuple(slice(max(step, 0), size + min(step, 0)) for step, size in zip(steps.tolist(), shape, strict=True))


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
