"""Invalid points: those without finite coordinates, and those of many at one and the same place.

Depth cameras write zeros, or another fixed value, for pixels without a measurement.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64

from stages.ingest.readers import Frame
from stages.kernels.points.quantisation import coarseness

_FEWEST = 8  # points at one place; fewer may coincide where scans were merged
_SHARE = 0.001  # least share of the frame's points at one place
_TIMES_USUAL = 10  # times the usual number at a place; clouds drawn with replacement hold some points 2 or 3 times
_USUAL = 0.95
_MOST_PLACES = 3  # more places are not due to a camera
_KEY = (0.8507207, 0.4127213, 0.3251893)  # direction along which different points differ


def kept_points(frame: Frame) -> Bool[np.ndarray, "points"]:
    """Which points of a frame are valid: they have finite coordinates and are not among very many at one place."""
    kept = np.isfinite(frame.points).all(axis=1)
    kept[kept] = ~_piled(frame.points[kept])
    return kept


def dropped_message(frames: Sequence[Frame], dropped: list[int]) -> str:
    """One line on the points that `kept_points` excludes. `dropped` is their number in each frame."""
    affected = [
        f"{count} of {len(frame.points)} in {frame.name}" for frame, count in zip(frames, dropped, strict=True) if count
    ]
    more = f" and {len(affected) - 5} more frames" if len(affected) > 5 else ""
    not_finite = sum(int((~np.isfinite(frame.points).all(axis=1)).sum()) for frame in frames)
    reasons = ["NaN or infinite coordinates"] * (not_finite > 0)
    if sum(dropped) > not_finite:
        reasons.append(f"many at one and the same place{_where(frames)}, as depth cameras write what they did not see")
    return f"dropped {sum(dropped)} points with {' or '.join(reasons)}: {', '.join(affected[:5])}{more}"


def _where(frames: Sequence[Frame]) -> str:
    """The first place with very many points."""
    for frame in frames:
        points = frame.points[np.isfinite(frame.points).all(axis=1)]
        if (piled := _piled(points)).any():
            return f" ({', '.join(f'{value:.6g}' for value in points[piled][0] + 0.0)})"  # + 0.0: no "-0"
    return ""


def _piled(points: Float64[np.ndarray, "points 3"]) -> Bool[np.ndarray, "points"]:
    """Which points lie with very many others at exactly one place, unless all do.

    In coarsely rounded frames valid points coincide too, so that there only zeros count as invalid.
    """
    piled = np.zeros(len(points), dtype=bool)
    keys = points[:, 0] * _KEY[0] + points[:, 1] * _KEY[1] + points[:, 2] * _KEY[2]
    least = max(_FEWEST, int(_SHARE * len(points)))
    in_order = np.sort(keys)
    if not (in_order[least - 1 :] == in_order[: max(len(points) - least + 1, 0)]).any():
        return piled
    _, first, counts = np.unique(keys, return_index=True, return_counts=True)
    large = counts >= max(least, _TIMES_USUAL * np.quantile(counts, _USUAL))
    places = points[first[large]]
    if len(places) > _MOST_PLACES:
        return piled
    for place in places:
        piled |= (points == place).all(axis=1)
    if piled.all() or (coarseness(points[~piled]) > 0 and (len(places) > 1 or places.any())):
        piled[:] = False
    return piled
