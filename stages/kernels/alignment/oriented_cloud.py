"""A cloud with the normal and the flatness of the surface at each of its points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, neighbours

NEIGHBOURS = 12
CURVED = 0.06  # share of a neighbourhood's variance along the normal at which a surface counts as curved
LEAST_FLATNESS = 0.02


@dataclass(frozen=True)
class OrientedCloud:
    """Points, unit normals of no particular sign, and flatness from LEAST_FLATNESS (curved) to one (a plane)."""

    p: Float64[np.ndarray, "points 3"]
    normals: Float64[np.ndarray, "points 3"]
    flatness: Float64[np.ndarray, "points"]

    @classmethod
    def of(cls, points: Float64[np.ndarray, "points 3"]) -> Self:
        """Fit a plane to the neighbourhood of each point."""
        near = np.concatenate([points[:, None], points[neighbours(points, NEIGHBOURS)[1]]], axis=1)
        offsets = near - near.mean(axis=1, keepdims=True)
        variances, directions = np.linalg.eigh(np.matmul(offsets.transpose(0, 2, 1), offsets))
        across = variances[:, 0] / (variances.sum(axis=1) + 1e-300)
        flatness = np.clip(1.0 - (across / CURVED) ** 2, LEAST_FLATNESS, 1.0)
        return cls(np.ascontiguousarray(points), directions[:, :, 0], flatness)

    @cached_property
    def tree(self) -> KDTree:
        return KDTree(self.p)

    def take(self, index: Int64[np.ndarray, "chosen"]) -> Self:
        """Some of the points, with what all points tell of the surface."""
        return type(self)(np.ascontiguousarray(self.p[index]), self.normals[index], self.flatness[index])

    def moved(self, Ts: Float64[np.ndarray, "*#points 4 4"]) -> Self:
        """The cloud moved by one transform, or by one for each point."""
        turned: np.ndarray = np.einsum("...ij,...j->...i", Ts[..., :3, :3], self.normals)
        return type(self)(np.ascontiguousarray(move_points(Ts, self.p)), turned, self.flatness)
