"""The true parts that a sequence shows, and the tree of these: what is never seen cannot be found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Int64

# a part is seen where some frame shows it by so many points, or by this share of its points if these are fewer
LEAST_POINTS = 10
LEAST_SHARE = 0.01


def seen_parts(labels: Sequence[Int64[np.ndarray, "points"]], parts: int) -> Bool[np.ndarray, "parts"]:
    """Which of the parts some frame shows, given each frame's true labels; all, if that is none."""
    seen = np.zeros(parts, dtype=bool)
    for of_frame in labels:
        least = max(1.0, min(LEAST_POINTS, LEAST_SHARE * len(of_frame)))
        seen |= np.bincount(of_frame, minlength=parts) >= least
    return seen if seen.any() else ~seen


def trees_of_seen(parent: Int64[np.ndarray, "parts"], seen: Bool[np.ndarray, "parts"]) -> list[Int64[np.ndarray, "_"]]:
    """The trees that a fit to what is seen may have, as the parent of each part: one, if all parts are seen.

    `parent` is a tree with one root. Children of a part that is left out hang on its parent; if it is the root, on its
    first child. A part that is not seen may nevertheless be found where others hang on it, as a link without points.
    So there is a tree of the seen parts, and one that keeps such links, too.
    """
    bearing = seen.copy()
    for _ in parent:  # a part bears what hangs on its children
        bearing[parent[bearing & (parent >= 0)]] = True
    return [_contracted(parent, seen)] + ([_contracted(parent, bearing)] if (bearing != seen).any() else [])


def _contracted(parent: Int64[np.ndarray, "parts"], kept: Bool[np.ndarray, "parts"]) -> Int64[np.ndarray, "kept"]:
    """The tree of the kept parts, of which there is at least one."""
    above = parent.copy()
    for _ in parent:  # skip one part that is left out at a time
        skipped = (above >= 0) & ~kept[above]
        above[skipped] = parent[above[skipped]]
    tops = np.flatnonzero(kept & (above < 0))
    above[tops[1:]] = tops[0]
    number = np.cumsum(kept) - 1
    return np.where(above >= 0, number[above], -1)[kept]
