"""Which frames are tried as the canonical one (A.5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64
from scipy.spatial import ConvexHull

from schemas.config import CanonicalFrameConfig
from schemas.errors import InputError
from stages.kernels.points.sampling import thinned

UNUSUAL = 4.0  # times as many points make half the spacing
FEW = 6  # frames, of which the most open ones are tried: so few are states in no order, and the middle one is any
ENOUGH = 20_000  # points that tell a cloud's hull

Frames = Sequence[Float64[np.ndarray, "points 3"]]


def candidate_frames(frames: Frames, config: CanonicalFrameConfig) -> tuple[int, ...]:
    """All frames to try: the configured ones, or those of the first ranks. Raises as `candidate_frame` does."""
    if config.frames:
        return tuple(candidate_frame(frames, frame=frame) for frame in config.frames)
    return tuple(candidate_frame(frames, candidate=rank) for rank in range(config.candidates))


def candidate_frame(frames: Frames, *, candidate: int = 0, frame: int | None = None) -> int:
    """The frame that a candidate is: `frame` where that is configured, else the one of rank `candidate`.

    Rank 0 is the middle frame; its neighbours follow, nearest first. Of a few frames the most open one comes first,
    whose convex hull is largest: there parts touch least, and most of their surface shows. Frames with `UNUSUAL` times
    the median count of points or more, or as much fewer, have no rank: most points of a far denser frame lie near none
    of the others', and a far sparser one shows parts by a few points. Where there are fewer frames than candidates,
    some are tried twice. Raises InputError for a configured frame that the sequence does not have.
    """
    frame_count = len(frames)
    if frame is not None:
        if not 0 <= frame < frame_count:
            raise InputError(f"canonical_frame.frames: found {frame}, expected 0..{frame_count - 1}; correct it")
        return frame
    middle = frame_count // 2
    usual = float(np.median([len(p) for p in frames]))
    alike = [t for t, p in enumerate(frames) if usual / UNUSUAL < len(p) < usual * UNUSUAL] or list(range(frame_count))
    if len(frames) <= FEW:
        ranked = sorted(alike, key=lambda t: (-openness(frames[t]), abs(t - middle), t))
    else:
        ranked = sorted(alike, key=lambda t: (abs(t - middle), t))
    return ranked[candidate % len(ranked)]


def openness(p: Float64[np.ndarray, "points 3"]) -> float:
    """The volume of a cloud's convex hull."""
    p = p[thinned(len(p), ENOUGH)]
    return float(ConvexHull(p, qhull_options="QJ").volume)  # QJ: flat clouds have a hull, too
