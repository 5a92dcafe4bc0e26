"""Which frames are tried as the canonical one (A.5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schemas.config import CanonicalFrameConfig
from schemas.errors import InputError

UNUSUAL = 4.0  # times as many points make half the spacing


def candidate_frames(point_counts: Sequence[int], config: CanonicalFrameConfig) -> tuple[int, ...]:
    """All frames to try: the configured ones, or those of the first ranks. Raises as `candidate_frame` does."""
    if config.frames:
        return tuple(candidate_frame(point_counts, frame=frame) for frame in config.frames)
    return tuple(candidate_frame(point_counts, candidate=rank) for rank in range(config.tried(len(point_counts))))


def candidate_frame(point_counts: Sequence[int], *, candidate: int = 0, frame: int | None = None) -> int:
    """The frame that a candidate is: `frame` where that is configured, else the one of rank `candidate`.

    Rank 0 is the middle frame; its neighbours follow, nearest first. `point_counts` are those of all frames. Frames
    with `UNUSUAL` times the median count of points or more, or as much fewer, have no rank: most points of a far denser
    frame lie near none of the others', and a far sparser one shows parts by a few points. Where there are fewer frames
    than candidates, some are tried twice. Raises InputError for a configured frame that the sequence does not have.
    """
    frame_count = len(point_counts)
    if frame is not None:
        if not 0 <= frame < frame_count:
            raise InputError(f"canonical_frame.frames: found {frame}, expected 0..{frame_count - 1}; correct it")
        return frame
    middle = frame_count // 2
    usual = float(np.median(point_counts))
    alike = [t for t, count in enumerate(point_counts) if usual / UNUSUAL < count < usual * UNUSUAL]
    nearest_first = sorted(alike or range(frame_count), key=lambda t: (abs(t - middle), t))
    return nearest_first[candidate % len(nearest_first)]
