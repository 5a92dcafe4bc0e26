"""Matches of two clouds by features of their points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int64

CHUNK = 1024  # rows of the score matrix that are held at a time


@dataclass(frozen=True)
class Matches:
    """Points of a source and a target cloud taken for the same place, and how sure that is, in [0, 1]."""

    source_index: Int64[np.ndarray, "matches"]
    target_index: Int64[np.ndarray, "matches"]
    confidence: Float64[np.ndarray, "matches"]


def mutual_nearest(
    source: Float[np.ndarray, "points features"], target: Float[np.ndarray, "targets features"]
) -> Matches:
    """Pairs of points whose features have each other's largest dot product; confident where no other is as large.

    For features of unit length that is the nearest in Euclid's sense too. The confidence is that of a two-way choice:
    one minus the second largest score over the largest, with scores in units of the spread of the best ones.
    """
    best, second, forward = _largest(source, target)
    backward = _largest(target, source)[2]
    index = np.arange(len(source))
    kept = np.flatnonzero(backward[forward] == index) if len(target) else np.zeros(0, dtype=np.int64)
    margin = best[kept] - second[kept]
    typical = np.median(margin) if len(kept) else 1.0
    return Matches(kept, forward[kept], margin / (margin + typical + 1e-12))


def _largest(
    a: Float[np.ndarray, "rows features"], b: Float[np.ndarray, "columns features"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Each row's largest and second largest dot product, and whose the largest is."""
    best, second, index = np.zeros(len(a)), np.zeros(len(a)), np.zeros(len(a), dtype=np.int64)
    for start in range(0, len(a) if len(b) > 1 else 0, CHUNK):
        rows = slice(start, start + CHUNK)
        scores = a[rows] @ b.T
        index[rows] = scores.argmax(axis=1)
        best[rows] = np.take_along_axis(scores, index[rows, None], axis=1)[:, 0]
        np.put_along_axis(scores, index[rows, None], -np.inf, axis=1)
        second[rows] = scores.max(axis=1)
    return best, second, index
