"""Parts and motions seen from another canonical frame: nothing is fitted anew."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, nearest


def seen_from(
    frame: int,
    p_frame: Float64[np.ndarray, "others 3"],
    p_canonical: Float64[np.ndarray, "points 3"],
    labels: Int64[np.ndarray, "points"],
    Ts_frame_canonical: Float64[np.ndarray, "frames parts 4 4"],
) -> tuple[Int64[np.ndarray, "others"], Float64[np.ndarray, "frames parts 4 4"]]:
    """Labels of the points of `frame`, and motions from where parts lie there.

    Each of its points gets the label of the nearest canonical point as moved there.
    """
    posed = move_points(Ts_frame_canonical[frame, labels], p_canonical)
    Ts_since_frame = Ts_frame_canonical @ np.linalg.inv(Ts_frame_canonical[frame])
    return labels[nearest(KDTree(posed), p_frame)[1]], Ts_since_frame
