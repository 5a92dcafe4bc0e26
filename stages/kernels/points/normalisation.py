"""The change between the input's coordinates and the normalised frame: p_input = p_normalised * scale + centre."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float, Float64


@dataclass(frozen=True)
class Normalisation:
    """A normalised frame: its origin in the input's coordinates, and the input's units per normalised unit."""

    centre: Float64[np.ndarray, "3"]
    scale: float

    @classmethod
    def of(cls, points: Float[np.ndarray, "points 3"]) -> Self:
        """Centred on the points' bounding box, whose diagonal is one."""
        low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
        return cls((low + high) / 2, float(np.linalg.norm(high - low)) or 1.0)

    def points(self, p_input: Float64[np.ndarray, "*batch 3"]) -> Float64[np.ndarray, "*batch 3"]:
        """The same points in the normalised frame."""
        return (p_input - self.centre) / self.scale

    def motions(self, Ts_input: Float64[np.ndarray, "*batch 4 4"]) -> Float64[np.ndarray, "*batch 4 4"]:
        """The same motions for points in the normalised frame."""
        Ts = Ts_input.copy()
        Ts[..., :3, 3] = (Ts[..., :3, :3] @ self.centre + Ts[..., :3, 3] - self.centre) / self.scale
        return Ts

    def motions_to_input(self, Ts_normalised: Float64[np.ndarray, "*batch 4 4"]) -> Float64[np.ndarray, "*batch 4 4"]:
        """The same motions for points in the input's coordinates."""
        Ts = Ts_normalised.copy()
        Ts[..., :3, 3] = self.scale * Ts[..., :3, 3] + self.centre - Ts[..., :3, :3] @ self.centre
        return Ts
