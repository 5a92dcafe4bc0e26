"""Rigid motions as 4 x 4 matrices, by numpy alone: torch takes seconds to import (`se3` is for gradients)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64


def move_points(
    Ts: Float64[np.ndarray, "*#batch 4 4"], p: Float[np.ndarray, "*#batch 3"]
) -> Float64[np.ndarray, "*batch 3"]:
    """Every point by a transform of its own; batch axes are broadcast."""
    moved: np.ndarray = np.einsum("...ij,...j->...i", Ts[..., :3, :3], p) + Ts[..., :3, 3]
    return moved


def best_rotation(covariance: Float64[np.ndarray, "*batch 3 3"]) -> Float64[np.ndarray, "*batch 3 3"]:
    """The rotation that best takes x to y, from the sum of centred x y^T (Kabsch); never a reflection."""
    U, _, Vt = np.linalg.svd(covariance)
    V = Vt.swapaxes(-1, -2).copy()
    V[..., 2] *= np.sign(np.linalg.det(V @ U.swapaxes(-1, -2)))[..., None]
    return V @ U.swapaxes(-1, -2)
