"""How far each true joint moves its child."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, Int64

from schemas.sequence import GroundTruth
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.sampling import point_spacing, thinned

POINTS = 200  # of a part, whose ways are measured


def joint_travels(
    truth: GroundTruth,
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    labels: Sequence[Int64[np.ndarray, "points"]],
) -> list[float]:
    """The longest way of a point between two frames by each joint alone, in point spacings.

    The points are those of the joint's child in all frames. 0 where there are none.
    """
    spacing = float(np.median([point_spacing(frame) for frame in frames if len(frame) > 1]))
    home = np.linalg.inv(truth.Ts_frame_first)
    travels = []
    for joint in truth.joints:
        p_first = np.concatenate(
            [
                move_points(home[t, joint.child], frame[own == joint.child])
                for t, (frame, own) in enumerate(zip(frames, labels, strict=True))
            ]
        )
        p_first = p_first[thinned(len(p_first), POINTS)]
        Ts_by_joint = home[:, joint.parent] @ truth.Ts_frame_first[:, joint.child]
        p = move_points(Ts_by_joint[:, None], p_first)
        ways = [np.linalg.norm(p[t:] - p[t], axis=-1).max(initial=0.0) for t in range(len(p))]
        travels.append(float(max(ways)) / spacing)
    return travels
