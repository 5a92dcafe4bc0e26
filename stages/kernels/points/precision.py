"""Whether 32-bit floats tell a cloud's points apart as finely as its sampling does."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from stages.kernels.points.sampling import point_spacing

FINENESS = 1e-3  # of the points' spacing


def float32_holds(points: Float[np.ndarray, "points 3"]) -> bool:
    """Whether 32-bit floats hold every coordinate to a thousandth of the points' spacing.

    They have 24 bits, and a coordinate that counts from far away, as geo-referenced ones do, spends them on the way.
    A single place has no spacing, and is held.
    """
    if len(points) == 0 or (points == points[0]).all():
        return True
    with np.errstate(over="ignore"):
        farthest = np.abs(points).max(initial=0.0).astype(np.float32)
    rounding = float(np.spacing(farthest)) / 2 if np.isfinite(farthest) else np.inf
    return rounding <= FINENESS * point_spacing(points)
