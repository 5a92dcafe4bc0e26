"""How far a model's points are from where they truly lie: the motion's yardsticks of A.9."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64

from schemas.sequence import METRES, GroundTruth, IngestedSequence, LengthUnit, PointSequence
from stages.kernels.motion.rigid_motion import best_motion, inverse, move_points


@dataclass(frozen=True)
class MotionErrors:
    """Means over frames and points of one canonical frame's points, normalised: errors, and what they are errors of."""

    recon: float
    motion: float
    epe: float
    flow: float
    acc5: float
    acc10: float

    def figures(self, scale: float) -> dict[str, Any]:
        """The fields of `Metrics`, for input units of which `scale` are one normalised unit."""
        return {
            "recon": self.recon * scale,
            "recon_percent": 100 * self.recon,
            "recon_of_motion_percent": _percent(self.recon, self.motion),
            "epe": self.epe * scale,
            "epe_percent": 100 * self.epe,
            "epe_of_flow_percent": _percent(self.epe, self.flow),
            "acc5": self.acc5,
            "acc10": self.acc10,
        }


def true_positions(ingested: IngestedSequence, canonical_frame: int) -> Float64[np.ndarray, "frames points 3"] | None:
    """Where the canonical frame's points of true parts lie in every frame: on the surface, or with their parts.

    None where the source tells neither.
    """
    of_object = ingested.of_object(canonical_frame)
    if (p_surface := ingested.on_surface(canonical_frame)) is not None:
        return p_surface[:, of_object]
    labels_true = ingested.true_labels(canonical_frame)
    if ingested.truth is None or labels_true is None:
        return None
    Ts_true = since_canonical(ingested.truth.Ts_frame_first, ingested.truth, canonical_frame)
    p_canonical = ingested.sequence.frames()[canonical_frame]
    return move_points(Ts_true[:, labels_true[of_object]], p_canonical[of_object])


def since_canonical(
    Ts_first: Float64[np.ndarray, "frames parts 4 4"], truth: GroundTruth, canonical_frame: int
) -> Float64[np.ndarray, "frames parts 4 4"]:
    """True motions from where the parts are in the canonical frame, given motions from frame 0."""
    return Ts_first @ np.linalg.inv(truth.Ts_frame_first[canonical_frame])


def in_shared_coordinates(
    p_predicted: Float64[np.ndarray, "frames points 3"],
    p_true: Float64[np.ndarray, "frames points 3"],
    truth: GroundTruth,
    canonical_frame: int,
) -> tuple[Float64[np.ndarray, "frames points 3"], Float64[np.ndarray, "frames points 3"]]:
    """Predicted and true positions without the motion of the whole, where each frame has coordinates of its own.

    Both are brought to the coordinates in which the true root stands still, so that the flow between frames has a
    meaning. There the prediction takes the rigid motion that is best over all points, in each frame.
    """
    root = int(np.flatnonzero(truth.parent < 0)[0])
    Ts_frame_root = since_canonical(truth.Ts_frame_first, truth, canonical_frame)[:, root]
    home = inverse(Ts_frame_root)[:, None]
    p_predicted, p_true = move_points(home, p_predicted), move_points(home, p_true)
    return placed(p_predicted, p_true), p_true


def placed(
    p_predicted: Float64[np.ndarray, "frames points 3"], p_true: Float64[np.ndarray, "frames points 3"]
) -> Float64[np.ndarray, "frames points 3"]:
    """The predicted positions after the best rigid motion to the true ones, in each frame."""
    return move_points(best_motion(p_predicted, p_true)[:, None], p_predicted)


def motion_errors(
    p_predicted: Float64[np.ndarray, "frames points 3"],
    p_true: Float64[np.ndarray, "frames points 3"],
    canonical_frame: int,
    sequence: PointSequence,
) -> MotionErrors:
    """Reconstruction error, and that of the flow between consecutive frames."""
    flow_error = np.linalg.norm(np.diff(p_predicted, axis=0) - np.diff(p_true, axis=0), axis=-1)
    flow_length = np.linalg.norm(np.diff(p_true, axis=0), axis=-1)
    acc5, acc10 = (
        float(_accurate(flow_error, flow_length, share, sequence.units, sequence.scale).mean())
        for share in (0.005, 0.01)
    )
    return MotionErrors(
        recon=float(np.linalg.norm(p_predicted - p_true, axis=-1).mean()),
        motion=float(np.linalg.norm(p_true - p_true[canonical_frame], axis=-1).mean()),
        epe=float(flow_error.mean()),
        flow=float(flow_length.mean()),
        acc5=acc5,
        acc10=acc10,
    )


def _percent(part: float, whole: float) -> float | None:
    """None of what does not move."""
    return 100 * part / whole if whole > 0 else None


def _accurate(
    error: Float64[np.ndarray, "pairs points"],
    length: Float64[np.ndarray, "pairs points"],
    share: float,
    units: LengthUnit,
    scale: float,
) -> Bool[np.ndarray, "pairs points"]:
    """Whether a flow's error is at most `share` of its true length, or `share` metres (0.005: 5 mm).

    Where the unit is unknown, `share` of the object's diagonal stands for the absolute threshold.
    """
    absolute = share if units == "unknown" else share / METRES[units] / scale
    return (error <= absolute) | (error <= share * length)
