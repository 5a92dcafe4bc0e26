"""Rough rigid motions of one cloud onto another, by correlation of their surfaces over all shifts at once."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from scipy.fft import irfftn, rfftn
from scipy.ndimage import gaussian_filter

from stages.kernels.alignment.oriented_cloud import OrientedCloud
from stages.kernels.motion.rigid_motion import from_parts

BLUR = 0.8  # cells
PEAK = 2  # cells around a peak in which no further one is looked for


def correlated_motions(
    source: OrientedCloud,
    target: OrientedCloud,
    rotations: Float64[np.ndarray, "rotations 3 3"],
    cell: float,
    cells: int,
    peaks: int,
) -> tuple[Float64[np.ndarray, "motions 4 4"], Float64[np.ndarray, "motions"]]:
    """The motions at the `peaks` best shifts for each rotation, and their correlations.

    Both clouds are counted into grids of `cells` to a side, one for each axis that normals point along, so that
    surfaces count only where they face alike. Shifts that leave the grid wrap round.
    """
    centre, target_centre = _middle(source.p), _middle(target.p)
    facing = _grids(target.p - target_centre, target.normals, cell, cells)
    spectrum = rfftn(gaussian_filter(facing, (0, BLUR, BLUR, BLUR), mode="constant"), axes=(1, 2, 3))
    Ts, correlations = [], []
    for R in rotations:
        turned = rfftn(_grids((source.p - centre) @ R.T, source.normals @ R.T, cell, cells), axes=(1, 2, 3))
        correlation = irfftn((spectrum * np.conj(turned)).sum(axis=0), s=(cells,) * 3)
        for _ in range(peaks):
            peak = np.array(np.unravel_index(correlation.argmax(), correlation.shape))
            shift = ((peak + cells // 2) % cells - cells // 2) * cell
            Ts.append(from_parts(R, target_centre + shift - R @ centre))
            correlations.append(correlation[tuple(peak)])
            correlation[np.ix_(*(np.arange(at - PEAK, at + PEAK + 1) % cells for at in peak))] = 0.0
    return np.stack(Ts), np.array(correlations)


def _middle(p: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "3"]:
    return (p.min(axis=0) + p.max(axis=0)) / 2


def _grids(
    p: Float64[np.ndarray, "points 3"], normals: Float64[np.ndarray, "points 3"], cell: float, cells: int
) -> Float64[np.ndarray, "3 cells cells cells"]:
    """How much surface in each cell faces along each axis."""
    place = np.floor(p / cell).astype(np.int64) + cells // 2
    inside = ((place >= 0) & (place < cells)).all(axis=1)
    index = np.ravel_multi_index(tuple(place[inside].T), (cells,) * 3)
    grids = [np.bincount(index, normals[inside, axis] ** 2, minlength=cells**3) for axis in range(3)]
    return np.sqrt(np.stack(grids)).reshape(3, cells, cells, cells)
