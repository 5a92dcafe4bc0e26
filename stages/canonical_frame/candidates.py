"""Which frames are tried as the canonical one (A.5)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from schemas.config import CanonicalFrameConfig
from schemas.errors import InputError
from schemas.sequence import PointSequence

UNUSUAL = 4.0  # times as many points make half the spacing
CELL = 0.02  # side of the cubes by which the surface of a frame is counted, in diagonals
SHOWS_MORE = 1.05  # times the middle frame's surface: another frame is worth being farther from the ends


def candidate_frames(sequence: PointSequence, config: CanonicalFrameConfig) -> tuple[int, ...]:
    """All frames to try: the configured ones, or those of the first ranks. Raises as `candidate_frame` does."""
    if config.frames:
        return tuple(candidate_frame(sequence, frame=frame) for frame in config.frames)
    return tuple(candidate_frame(sequence, candidate=rank) for rank in range(config.tried(sequence.frame_count)))


def candidate_frame(sequence: PointSequence, *, candidate: int = 0, frame: int | None = None) -> int:
    """The frame that a candidate is: `frame` where that is configured, else the one of rank `candidate`.

    Rank 0 is the middle frame, or what `telling_frame` takes in its place; its neighbours follow, nearest first. Frames
    with `UNUSUAL` times the median count of points or more, or as much fewer, have no rank: most points of a far denser
    frame lie near none of the others', and a far sparser one shows parts by a few points. Where there are fewer frames
    than candidates, some are tried twice. Raises InputError for a configured frame that the sequence does not have.
    """
    frame_count = sequence.frame_count
    if frame is not None:
        if not 0 <= frame < frame_count:
            raise InputError(f"canonical_frame.frames: found {frame}, expected 0..{frame_count - 1}; correct it")
        return frame
    first = telling_frame(sequence)
    usual = float(np.median(sequence.point_counts))
    alike = [t for t, count in enumerate(sequence.point_counts) if usual / UNUSUAL < count < usual * UNUSUAL]
    nearest_first = sorted(alike or range(frame_count), key=lambda t: (abs(t - first), t))
    return nearest_first[candidate % len(nearest_first)]


def telling_frame(sequence: PointSequence) -> int:
    """The middle frame; where cameras are known, the frame of the middle half that shows clearly more surface.

    A door that a camera sees edge on in the middle frame has few points there, in pieces.
    """
    middle = sequence.frame_count // 2
    if sequence.viewpoints is None:
        return middle
    frames, aside = sequence.frames(), sequence.frame_count // 4
    shown = {t: surface_shown(frames[t]) for t in range(middle - aside, middle + aside)}
    most = max(shown, key=lambda t: shown[t], default=middle)
    return most if shown and shown[most] > SHOWS_MORE * shown[middle] else middle


def surface_shown(p: Float64[np.ndarray, "points 3"]) -> int:
    """How many cubes of side `CELL` hold points."""
    return len(np.unique(np.floor(p / CELL).astype(np.int64), axis=0))
