"""The observable points of a sequence: those whose part no other part's motion could stand for.

A round part that turns about its own axis looks alike however it turns, a plate that slides in its own plane too,
and parts that move alike are one to every observer. Which part such points belong to is a guess, however good the fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64, Int64

from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import point_spacing

# RMS distance to the nearest point of the true surface, in that surface's own spacings, within which a motion is borne
# out: where it is right, about 1.1
ON_SURFACE = 1.6
FAR = 10.0  # spacings; farther is no worse


def observable_points(
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    labels: Sequence[Int64[np.ndarray, "points"]],
    Ts_frame_canonical: Float64[np.ndarray, "frames parts 4 4"],
    canonical_frame: int,
) -> Bool[np.ndarray, "points"]:
    """Which of the canonical frame's points leave the true surface, in some frames, with every part but their own.

    `labels` are each frame's true ones and `Ts_frame_canonical` the true motions. The surface of a frame is that of
    all frames' points, each moved there with its part.
    """
    p, own = frames[canonical_frame], labels[canonical_frame]
    inverse = np.linalg.inv(Ts_frame_canonical)
    fused = np.concatenate(
        [move_points(inverse[t, part], cloud) for t, (cloud, part) in enumerate(zip(frames, labels, strict=True))]
    )
    fused_part, spacing = np.concatenate(labels), point_spacing(fused)
    parts = Ts_frame_canonical.shape[1]
    squares = np.zeros((parts, len(p)))
    for Ts in Ts_frame_canonical:
        surface = KDTree(move_points(Ts[fused_part], fused))
        for part in range(parts):
            distance = nearest(surface, move_points(Ts[part], p))[0]
            squares[part] += np.minimum(distance / spacing, FAR) ** 2
    borne_out = np.sqrt(squares / len(frames)) < ON_SURFACE
    borne_out[own, np.arange(len(p))] = False
    return np.asarray(~borne_out.any(axis=0))
