"""Sequences in which point i is the same surface point in every frame, such as registrations of scans.

Each frame is sampled anew, as if by a scanner. The correspondence gives the true motion of every sample.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64
from pykdtree.kdtree import KDTree

from schemas.config import CleanConfig, IngestConfig
from schemas.errors import InputError
from schemas.sequence import IngestedSequence, LengthUnit
from stages.ingest.formats.triangles import file_triangles
from stages.ingest.listing import is_folder
from stages.ingest.normalise import normalise
from stages.ingest.readers import Frame, frame_files, read_frames
from stages.ingest.tracks import normalise_surface, sample_frames, sample_vertices

_log = logging.getLogger("rearticulate.ingest")

# Points do not correspond if the median distance of neighbours exceeds _TORN times that in the first frame and
# _TORN_SHARE of that between arbitrary points.
_TORN, _TORN_SHARE = 3.0, 0.3
_CHECKED = 2000  # points whose neighbours are checked
_LEAST_SPACING = 1e-4  # least spacing as a share of the diagonal, for coinciding points

Vertices = Float64[np.ndarray, "frames vertices 3"]
Triangles = Int64[np.ndarray, "triangles 3"]


def read_corresponding(
    path: Path, truth: Path | None, config: IngestConfig, rng: np.random.Generator
) -> IngestedSequence:
    """Read corresponding frames, sample the chosen ones anew, and keep their surface as the truth.

    The triangles come from the first .ply, or from the array `faces` of the .npz. Without triangles the samples are
    drawn from the points. Raises InputError if the frames cannot be read or their points do not correspond.
    """
    if truth is not None:
        _log.warning("%s: left out, since the points' correspondence stands for the truth (ingest.correspond)", truth)
    if config.clean != CleanConfig():
        _log.warning("%s: not cleaned up (ingest.clean), since its points correspond (ingest.correspond)", path)
    frames = read_frames(path, 1, config.max_points)
    chosen = [frames[index] for index in chosen_frames(len(frames), config, str(path))]
    first = chosen[0]
    for frame in chosen:
        if len(frame.points) != len(first.points):
            raise InputError(
                f"{path}: found {len(first.points)} points in {first.name} and {len(frame.points)} in {frame.name}, "
                "expected as many in every frame, since point i is to be the same surface point in all "
                "(ingest.correspond); leave the setting out where it is not"
            )
    vertices = np.stack([frame.points for frame in chosen])
    file = frame_files(path)[0] if is_folder(path) else path
    triangles = file_triangles(file, vertices.shape[1], config.max_points)
    return sampled_sequence(vertices, triangles, [frame.name for frame in chosen], config, config.units, rng)


def chosen_frames(count: int, config: IngestConfig, where: str) -> range:
    """Choose the frames to use from `count`. Raises InputError if there are fewer than two."""
    settings = config.registrations
    chosen = range(settings.first, count, config.every)[: settings.frames]
    if len(chosen) < 2:
        raise InputError(
            f"{where}: found {count} frames, of which the settings leave {len(chosen)}, expected at least two; "
            f"lower ingest.registrations.first ({settings.first}) or ingest.every ({config.every})"
        )
    return chosen


def sampled_sequence(
    vertices: Vertices,
    triangles: Triangles | None,
    names: Sequence[str],
    config: IngestConfig,
    units: LengthUnit,
    rng: np.random.Generator,
) -> IngestedSequence:
    """Sample a sequence from a surface with known vertices in every frame, which becomes the truth of its motion.

    Raises InputError for coordinates that are NaN or infinite, and for points that do not correspond.
    """
    _check_finite(vertices, names)
    _check_neighbours(vertices, names)
    count = config.registrations.points
    if triangles is None:
        points, surface = sample_vertices(vertices, count, rng)
    else:
        points, surface = sample_frames(vertices, triangles, count, rng)
    frames = [Frame(name, of_frame) for name, of_frame in zip(names, points, strict=True)]
    sequence = normalise(frames, config, units)
    return IngestedSequence(sequence=sequence, surface=normalise_surface(surface, frames, sequence))


def _check_finite(vertices: Vertices, names: Sequence[str]) -> None:
    for name, of_frame in zip(names, vertices, strict=True):
        if not (good := np.isfinite(of_frame).all(axis=1)).all():
            raise InputError(
                f"{name}: found NaN or infinite coordinates at {np.count_nonzero(~good)} points, the first at "
                f"{int(good.argmin())}, expected finite ones of every corresponding point; leave these points out of "
                "all frames, or this frame"
            )


def _check_neighbours(vertices: Vertices, names: Sequence[str]) -> None:
    """Raise InputError unless neighbours in the first frame remain neighbours, as on one surface."""
    first = vertices[0]
    if len(first) < 2:
        return
    index = np.unique(np.linspace(0, len(first) - 1, _CHECKED).astype(np.int64))
    near = KDTree(first).query(first[index], k=2)[1].astype(np.int64)
    apart = _apart(vertices, index, np.where(near[:, 0] == index, near[:, 1], near[:, 0]))
    anyhow = _apart(vertices, index, np.roll(index, len(index) // 2))
    usual = max(float(apart[0]), _LEAST_SPACING * float(np.linalg.norm(np.ptp(first, axis=0))))
    torn = int((apart / np.maximum(anyhow, usual)).argmax())
    if apart[torn] > max(_TORN * usual, _TORN_SHARE * anyhow[torn]):
        raise InputError(
            f"{names[torn]}: found neighbours of {names[0]} {apart[torn] / usual:.0f} times as far apart, expected the "
            "same surface point at the same place in every frame's order; register the frames, or give them as scans "
            "(without ingest.correspond)"
        )


def _apart(
    vertices: Vertices, index: Int64[np.ndarray, "pairs"], other: Int64[np.ndarray, "pairs"]
) -> Float64[np.ndarray, "frames"]:
    """The median distance of pairs of points, in every frame."""
    distances: Float64[np.ndarray, "frames"] = np.median(
        np.linalg.norm(vertices[:, index] - vertices[:, other], axis=-1), axis=1
    )
    return distances
