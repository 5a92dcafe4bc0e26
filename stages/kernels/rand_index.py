"""How well two labellings of the same points agree, whatever the labels are called (Hubert and Arabie 1985)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int64


def rand_index(a: Int64[np.ndarray, "points"], b: Int64[np.ndarray, "points"]) -> float:
    """The share of pairs of points on which both agree: together in both, or apart in both. 1 without any pair."""
    together, only_a, only_b, apart = _pairs(a, b)
    return (together + apart) / total if (total := together + only_a + only_b + apart) else 1.0


def adjusted_rand_index(a: Int64[np.ndarray, "points"], b: Int64[np.ndarray, "points"]) -> float:
    """The Rand index, shifted and scaled so that chance gives 0 and equal labellings give 1."""
    together, only_a, only_b, apart = _pairs(a, b)
    if only_a == only_b == 0:
        return 1.0
    chance = (together + only_a) * (only_a + apart) + (together + only_b) * (only_b + apart)
    return 2 * (together * apart - only_a * only_b) / chance


def _pairs(a: Int64[np.ndarray, "points"], b: Int64[np.ndarray, "points"]) -> tuple[int, int, int, int]:
    """How many ordered pairs of points are together in both, in `a` only, in `b` only, and in neither.

    As integers of Python, which do not overflow when they are multiplied.
    """

    def together(labels: Int64[np.ndarray, "points ..."]) -> int:
        counts = np.unique(labels, axis=0, return_counts=True)[1]
        return int((counts * (counts - 1)).sum())

    both, in_a, in_b = together(np.stack([a, b], axis=-1)), together(a), together(b)
    return both, in_a - both, in_b - both, len(a) * (len(a) - 1) - in_a - in_b + both
