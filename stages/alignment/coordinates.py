"""The way between frames' own coordinates and common ones."""

from __future__ import annotations

import numpy as np

from schemas.alignment import Alignment
from schemas.kinematic import KinematicModel
from schemas.sequence import PointSequence
from stages.kernels.kinematics.closed_form import nearest_point_to_origin
from stages.kernels.motion.rigid_motion import inverse, move_points


def in_common_coordinates(sequence: PointSequence, alignment: Alignment) -> PointSequence:
    """The sequence with all frames, and the viewpoints where they are known, in common coordinates."""
    if not alignment.own_frames:
        return sequence
    Ts = alignment.Ts_common_frame
    points = np.concatenate([move_points(T, frame) for T, frame in zip(Ts, sequence.frames(), strict=True)])
    viewpoints = None if sequence.viewpoints is None else move_points(Ts[:, None], sequence.viewpoints)
    return sequence.replace(points=points, viewpoints=viewpoints)


def in_own_coordinates(model: KinematicModel, alignment: Alignment) -> KinematicModel:
    """A model of common coordinates in those of its canonical frame. Its motions lead to the frames' own coordinates.

    So the root's motion holds the place of each scan.
    """
    if not alignment.own_frames:
        return model
    T_common_canonical = alignment.Ts_common_frame[model.canonical_frame]
    T_canonical_common = inverse(T_common_canonical)
    has_axis = np.array([kind.has_axis for kind in model.kinds], dtype=bool)[:, None]
    axis = model.axis @ T_canonical_common[:3, :3].T
    point = move_points(T_canonical_common, model.point)
    Ts_frame_common = inverse(alignment.Ts_common_frame)[:, None]
    return model.replace(
        Ts_frame_canonical=Ts_frame_common @ model.Ts_frame_canonical @ T_common_canonical,
        axis=axis,
        point=np.where(has_axis, nearest_point_to_origin(axis, point), point),
    )
