"""Clean-up of scans: what lies outside of a box, the plane that the object stands on, outliers, and specks.

Each step looks at one frame alone and tells which of its points are kept.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from schemas.config import CleanConfig, Corners, IngestConfig
from schemas.errors import InputError
from stages.ingest.dropping import kept_points
from stages.ingest.formats.cloud import Points
from stages.ingest.readers import Frame
from stages.ingest.support_plane import above_support
from stages.kernels.points.nearest import SURFACE_NEIGHBOURS, KDTree, nearest, neighbours
from stages.kernels.points.sampling import point_spacing

_log = logging.getLogger("rearticulate.ingest")

_FEWEST = 4  # points that have neighbours and a plane
WORDS = {
    "box": "outside of the box",
    "plane": "of the plane that the object stands on",
    "outliers": "outliers",
    "specks": "in separate specks",
}

Mask = Bool[np.ndarray, "points"]


@dataclass(frozen=True)
class Cleaned:
    """Frames after the clean-up, which points of the frames before are kept, and how many each step took of each."""

    frames: list[Frame]
    kept: list[Mask]
    taken: dict[str, tuple[int, ...]]

    def remarks(self) -> tuple[str, ...]:
        """What the clean-up took, in one line; none where it had nothing to do."""
        if not self.taken:
            return ()
        counts = {step: sum(of_frames) for step, of_frames in self.taken.items()}
        parts = ", ".join(f"{count:,} {WORDS[step]}" for step, count in counts.items())
        return (f"the clean-up took {sum(counts.values()):,} of {sum(map(len, self.kept)):,} points: {parts}",)


def clean(frames: Sequence[Frame], config: IngestConfig, rng: np.random.Generator) -> Cleaned:
    """Clean all frames up. Points without finite coordinates are not looked at, and stay.

    Raises InputError, naming the frame, where fewer than `config.min_points` points are left.
    """
    steps = [step for step in WORDS if getattr(config.clean, step)]
    if not steps:
        return Cleaned(list(frames), [np.ones(len(frame.points), dtype=bool) for frame in frames], {})
    kept = []
    taken: dict[str, list[int]] = {step: [] for step in steps}
    for frame in frames:
        valid = kept_points(frame)
        left = np.flatnonzero(valid)
        for step in steps:
            mask = _step(step, frame.points[left], config.clean, rng)
            taken[step].append(int((~mask).sum()))
            left = left[mask]
        if len(left) < config.min_points <= valid.sum():
            found = ", ".join(f"{counts[-1]} {WORDS[step]}" for step, counts in taken.items())
            raise InputError(
                f"{frame.name}: the clean-up left {len(left)} of {valid.sum()} points ({found}), expected at least "
                f"{config.min_points} (ingest.min_points); loosen ingest.clean or leave this frame out"
            )
        mask = ~valid
        mask[left] = True
        kept.append(mask)
    if "plane" in steps:
        _warn_of_planes(frames, taken["plane"])
    return Cleaned(
        [only(frame, mask) for frame, mask in zip(frames, kept, strict=True)],
        kept,
        {step: tuple(counts) for step, counts in taken.items()},
    )


def only(frame: Frame, mask: Mask) -> Frame:
    """The frame with some of its points."""
    return replace(frame, points=frame.points[mask], colours=None if frame.colours is None else frame.colours[mask])


def _step(step: str, points: Points, config: CleanConfig, rng: np.random.Generator) -> Mask:
    if step == "box" and config.box is not None:
        return in_box(points, config.box)
    if len(points) < _FEWEST:
        return np.ones(len(points), dtype=bool)
    if step == "plane":
        return above_support(points, config.plane_share, rng)
    if step == "outliers":
        return near_others(points, config.neighbours, config.outliers)
    return in_large_pieces(points, config.specks, config.gap)


def in_box(points: Points, box: Corners) -> Mask:
    """Which points lie in a box, given by its least and its greatest corner."""
    low, high = np.array(box).reshape(2, 3)
    inside: Mask = np.all((points >= low) & (points <= high), axis=1)
    return inside


def near_others(points: Points, count: int, deviations: float) -> Mask:
    """Which points are no statistical outliers.

    The mean distance to a point's `count` neighbours may exceed the mean of all points by so many standard deviations.
    """
    distance = neighbours(points, count)[0].mean(axis=1)
    kept: Mask = np.asarray(distance <= distance.mean() + deviations * distance.std())
    return kept


def in_large_pieces(points: Points, share: float, gap: float) -> Mask:
    """Which points are in pieces that hold at least a share of all. A gap of so many point spacings parts pieces.

    Pieces of neighbours are formed first; then small ones join the large ones that they are near to.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    reach = gap * point_spacing(points)
    distances, indices = neighbours(points, SURFACE_NEIGHBOURS)
    near = distances <= reach
    ends = np.repeat(np.arange(len(points)), near.sum(axis=1)), indices[near]
    graph = coo_array((np.ones(len(ends[0])), ends), shape=(len(points), len(points)))
    piece = connected_components(graph, directed=False)[1]
    sizes = np.bincount(piece)
    large = sizes >= min(share * len(points), sizes.max())
    joined = large
    while joined.any() and not large[piece].all():
        rest = np.flatnonzero(~large[piece])
        distance = nearest(KDTree(points[joined[piece]]), points[rest])[0]
        joined = np.bincount(piece[rest[distance <= reach]], minlength=len(sizes)) > 0
        large = large | joined
    kept: Mask = large[piece]
    return kept


def _warn_of_planes(frames: Sequence[Frame], counts: list[int]) -> None:
    if without := [frame.name for frame, count in zip(frames, counts, strict=True) if not count]:
        _log.warning(
            "found no plane that the object stands on in %d of %d frames (%s%s), so that nothing was taken there",
            len(without),
            len(frames),
            ", ".join(without[:3]),
            ", ..." if len(without) > 3 else "",
        )
