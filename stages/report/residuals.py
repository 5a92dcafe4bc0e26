"""Residuals of the fitted model: nearest distances between it and the frames, in both directions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from schemas.model_file import Result
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import thinned

MOST_QUERIES = 8192  # points of each cloud whose nearest neighbours are searched


def part_residuals(result: Result, frames: Sequence[Float64[np.ndarray, "_ 3"]]) -> Float64[np.ndarray, "frames parts"]:
    """RMS nearest distance of each part in each frame, in % of the canonical cloud's diagonal.

    The distances are those from the part's posed canonical points to the frame, and those to the model from the frame's
    points that are nearest to the part. The residual is 0 in the canonical frame, and for a part without points.
    """
    p = result.canonical_points.astype(np.float64)
    parts = len(result.model.parts)
    chosen = thinned(len(p), MOST_QUERIES)
    residuals = np.zeros((len(frames), parts))
    for t, frame in enumerate(frames):
        posed = move_points(result.T_frame_canonical[t][result.labels], p)
        there = nearest(KDTree(frame), posed[chosen])[0]
        back, index = nearest(KDTree(posed), frame[thinned(len(frame), MOST_QUERIES)])
        part = np.concatenate([result.labels[chosen], result.labels[index]])
        squared = np.concatenate([there, back]) ** 2
        residuals[t] = np.sqrt(
            np.bincount(part, squared, minlength=parts) / np.maximum(np.bincount(part, minlength=parts), 1)
        )
    return 100 * residuals / _diagonal(p)


def sampling_floor(result: Result) -> float:
    """The residual of a perfect model, in % of the diagonal: the RMS distance of points from their neighbours.

    It is due to sampling. An independent sample is as far from its nearest point as points are from their neighbours.
    """
    p = np.unique(result.canonical_points.astype(np.float64), axis=0)
    if len(p) < 2:
        return 0.0
    distance = KDTree(p).query(p[thinned(len(p), MOST_QUERIES)], k=2)[0][:, 1]
    return 100 * float(np.sqrt((distance**2).mean())) / _diagonal(p)


def _diagonal(p: Float64[np.ndarray, "points 3"]) -> float:
    return float(np.linalg.norm(np.ptp(p, axis=0))) or 1.0
