"""Where two parts touch."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from stages.kernels.points.nearest import KDTree, nearest

# a contact place: the points of a part whose distance from its parent is at most that of the nearest one, times
# FARTHER, plus WIDTH of the part's longest side
FARTHER, WIDTH = 1.5, 0.02


def next_to_contact(
    parent: Float64[np.ndarray, "points 3"],
    child: Float64[np.ndarray, "others 3"],
    axis: Float64[np.ndarray, "3"],
    point: Float64[np.ndarray, "3"],
) -> Float64[np.ndarray, "3"]:
    """The point of a joint's axis next to where its child touches its parent; `point` is any of the axis.

    Where one of them has no points, next to the other's middle.
    """
    if len(parent) and len(child):
        distance = nearest(KDTree(parent), child)[0]
        near = child[distance <= FARTHER * distance.min() + WIDTH * np.ptp(child, axis=0).max()]
    else:
        near = np.concatenate([parent, child, point[None]])
    along: np.ndarray = axis * (axis @ (near.mean(axis=0) - point))
    return point + along
