"""Conversion of frames in any unit to the normalised frame, centred on the object and with a diagonal of one."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64

from schemas.artifact import GREATEST
from schemas.config import IngestConfig
from schemas.errors import InputError
from schemas.sequence import GroundTruth, LengthUnit, PointSequence, TrueJoint
from stages.ingest.digits import warn_of_lost_digits
from stages.ingest.dropping import dropped_message, kept_points
from stages.ingest.formats.cloud import Colours, Points
from stages.ingest.readers import Frame
from stages.ingest.truth import RawTruth, check_truth

_log = logging.getLogger("rearticulate.ingest")

_LARGEST_COORDINATE = GREATEST / 1000  # so that motions and joints of such points keep the bound, too
_LARGEST_SIZE_RATIO = 100.0  # between frames; no object grows by so much, but mixed millimetres and metres do
_LEAST_SIZE = 1e-100
_LEAST_RELATIVE_SIZE = 1e-12  # smaller extents of a frame are rounding noise of its coordinates
_LEAST_WIDTH = 1e-6  # of a frame, relative to its length; a thinner one has no normals
_FIRST_FRAME_TOLERANCE = 1e-3


def normalise(frames: Sequence[Frame], config: IngestConfig, units: LengthUnit) -> PointSequence:
    """Drop invalid points, and move and scale the frames to the normalised frame.

    The scale is the median diagonal of the frames' bounding boxes. The centre is the median of the boxes' centres. So a
    stray point in a few frames changes neither. One warning counts the dropped points, another one reports lost digits.

    Viewpoints are kept where all frames have some.

    Raises InputError, naming the frame, for viewpoints in differing numbers, for too few valid points, for points that
    are all equal, for coordinates that overflow, and for sizes that only mixed units explain.
    """
    masks = [kept_points(frame) for frame in frames]
    kept = [frame.points[mask] for frame, mask in zip(frames, masks, strict=True)]
    for frame, points in zip(frames, kept, strict=True):
        _check_frame(frame, points, config.min_points)
    lowest = np.array([points.min(axis=0) for points in kept])
    highest = np.array([points.max(axis=0) for points in kept])
    diagonals = np.linalg.norm(highest - lowest, axis=1)
    _check_sizes(frames, diagonals)
    scale = float(np.median(diagonals))
    centre = np.median((lowest + highest) / 2, axis=0)
    dropped = np.array([len(frame.points) - len(points) for frame, points in zip(frames, kept, strict=True)])
    if dropped.any():
        _log.warning(dropped_message(frames, dropped.tolist()))
    warn_of_lost_digits([frame.name for frame in frames], kept)
    return PointSequence(
        points=(np.concatenate(kept) - centre) / scale,
        point_counts=np.array([len(points) for points in kept], dtype=np.int64),
        dropped_counts=dropped.astype(np.int64),
        colours=_colours(frames, masks),
        scale=scale,
        centre=tuple(centre.tolist()),
        units=units,
        frame_names=tuple(frame.name for frame in frames),
        viewpoints=_viewpoints(frames, centre, scale),
    )


def _colours(frames: Sequence[Frame], masks: Sequence[Bool[np.ndarray, "points"]]) -> Colours | None:
    """The colours of the kept points of all frames. None, with a warning, where only some frames have colours."""
    colours = [frame.colours[mask] for frame, mask in zip(frames, masks, strict=True) if frame.colours is not None]
    if len(colours) == len(frames):
        return np.concatenate(colours)
    if colours:
        without = next(frame.name for frame in frames if frame.colours is None)
        _log.warning("left out the colours, which %s and maybe other frames lack", without)
    return None


def _viewpoints(
    frames: Sequence[Frame], centre: Float64[np.ndarray, "3"], scale: float
) -> Float64[np.ndarray, "frames cameras 3"] | None:
    """The normalised viewpoints, or None unless all frames have some. Raises InputError for differing numbers."""
    known = [(frame, frame.viewpoints) for frame in frames if frame.viewpoints is not None]
    if len(known) < len(frames):
        return None
    first = len(known[0][1])
    for frame, p_viewpoints in known:
        if len(p_viewpoints) != first:
            raise InputError(
                f"{frame.name}: found {len(p_viewpoints)} viewpoints, but {first} in {known[0][0].name}; "
                "expected equally many in all frames, or none"
            )
    return (np.stack([p_viewpoints for _, p_viewpoints in known]) - centre) / scale


def normalise_truth(truth: RawTruth, frames: Sequence[Frame], sequence: PointSequence) -> GroundTruth:
    """Convert the ground truth of `frames` to the normalised frame of the `sequence` made from them.

    Dropped points lose their labels. A transform becomes S^-1 T S, where S maps normalised to input coordinates.
    Points on axes are converted as points, and prismatic states as lengths. Raises InputError if the truth does not fit
    the frames or does not start from frame 0.
    """
    check_truth(truth, [len(frame.points) for frame in frames], "ground truth")
    labels = [of_frame[kept_points(frame)] for of_frame, frame in zip(truth.labels, frames, strict=True)]
    Ts_frame_first = normalise_transforms(truth.Ts_frame_first, sequence)
    Ts_novel_first = normalise_transforms(truth.Ts_novel_first, sequence)
    _check_distances(Ts_frame_first, Ts_novel_first)
    error = np.abs(Ts_frame_first[0] - np.eye(4)).max(axis=(-2, -1))
    if error.max() > _FIRST_FRAME_TOLERANCE:
        raise InputError(
            f"ground truth: part {int(error.argmax())} is moved in frame 0, expected transforms from frame 0 "
            "to frame t; multiply each by the inverse of frame 0's"
        )
    return GroundTruth(
        labels=np.concatenate(labels).astype(np.int64),
        Ts_frame_first=Ts_frame_first,
        Ts_novel_first=Ts_novel_first,
        parent=truth.parent,
        part_names=truth.part_names,
        joints=tuple(_normalise_joint(joint, sequence) for joint in truth.joints),
        own_coordinates=truth.own_coordinates,
    )


def normalise_transforms(
    Ts: Float64[np.ndarray, "*batch 4 4"], sequence: PointSequence
) -> Float64[np.ndarray, "*batch 4 4"]:
    """Convert transforms of input coordinates to transforms of normalised coordinates: S^-1 T S."""
    centre = np.asarray(sequence.centre)
    normalised = Ts.copy()
    normalised[..., :3, 3] = (Ts[..., :3, :3] @ centre + Ts[..., :3, 3] - centre) / sequence.scale
    return normalised


def _normalise_joint(joint: TrueJoint, sequence: PointSequence) -> TrueJoint:
    x, y, z = ((np.asarray(joint.point) - sequence.centre) / sequence.scale).tolist()
    unit = sequence.scale if joint.kind.turns == "none" else 1.0
    return joint.model_copy(update={"point": (x, y, z), "states": tuple(state / unit for state in joint.states)})


def _check_distances(*Ts: Float64[np.ndarray, "*batch 4 4"]) -> None:
    farthest = max(float(np.abs(of_states).max(initial=0)) for of_states in Ts)
    if farthest > GREATEST:
        raise InputError(
            f"ground truth: found a motion by {farthest:.3g} times the object's size, expected at most {GREATEST:g}; "
            "give the transforms in the units of the frames"
        )


def _on_one_line(points: Points) -> bool:
    offsets = (points - points.mean(axis=0)) / np.ptp(points, axis=0).max()
    _, second, first = np.linalg.eigvalsh(offsets.T @ offsets)
    return bool(second <= _LEAST_WIDTH**2 * first)


def _check_frame(frame: Frame, points: Points, min_points: int) -> None:
    if len(points) < min_points:
        raise InputError(
            f"{frame.name}: found {len(points)} points with finite coordinates at places of their own "
            f"(of {len(frame.points)}), "
            f"expected at least {min_points} (ingest.min_points); leave this frame out or scan it again"
        )
    largest = np.abs(points).max()
    if largest > _LARGEST_COORDINATE:
        raise InputError(
            f"{frame.name}: found a coordinate of {largest:.3g}, expected at most {_LARGEST_COORDINATE:g}; "
            "check how the file was written"
        )
    if np.ptp(points, axis=0).max() <= max(_LEAST_RELATIVE_SIZE * largest, _LEAST_SIZE):
        raise InputError(
            f"{frame.name}: found {len(points)} points that are all equal, expected an object with an extent; "
            "check how the file was written"
        )
    if _on_one_line(points):
        raise InputError(
            f"{frame.name}: found {len(points)} points on one straight line, expected a surface; "
            "check which columns were written"
        )


def _check_sizes(frames: Sequence[Frame], diagonals: Float64[np.ndarray, "frames"]) -> None:
    smallest, largest = int(diagonals.argmin()), int(diagonals.argmax())
    ratio = diagonals[largest] / diagonals[smallest]
    if ratio <= _LARGEST_SIZE_RATIO:
        return
    middle = np.sort(diagonals)[len(diagonals) // 2]
    odd, other = smallest, largest
    if diagonals[largest] / middle > middle / diagonals[smallest]:
        odd, other = largest, smallest
    raise InputError(
        f"{frames[odd].name}: found a bounding box with a diagonal of {diagonals[odd]:.4g}, but {diagonals[other]:.4g} "
        f"in {frames[other].name}, a factor of {ratio:.4g}; expected one unit of length in all frames: "
        "convert this frame or remove its stray points"
    )
