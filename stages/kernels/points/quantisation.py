"""How coarse a cloud's coordinates are: what is left where digits were lost on the way to a file.

Digits are lost by single precision far from the origin, by a text with few of them, and by whole numbers. What is
left lies on steps, and where these are as wide as the points are apart, shapes and motions blur.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64

from stages.kernels.points.sampling import point_spacing, thinned

_LOOKED_AT = 4096  # points that are enough to see steps; the stages work on about as many
_EQUAL = 1e-12  # values that differ by less, relative to the largest, differ by rounding in double precision
_SURE_GAPS = 9  # so many gaps between values, nearly all multiples of one step, are no chance
_REGULAR_SHARE = 0.9  # share of the gaps that are multiples of the step
_REGULAR = 0.1  # how near to a multiple, in steps
_FAR = 100.0  # offset from the origin, in sizes of the cloud, at which steps are more likely than a regular shape
_VERY_FAR = 1000.0  # and at which nobody puts a point at a round number by chance
_COARSE_IN_ONE = 1.2  # steps, in spacings: wider in any axis than a regular grid's, which loses nothing
_COARSE_IN_ALL = 0.5  # in all axes, which no regular surface has


def coarseness(points: Float[np.ndarray, "points 3"]) -> float:
    """The widest quantisation step in spacings of the cloud where digits are lost that are needed, else 0.

    `points` are finite, in the input's coordinates. From about 0.5 on, the steps are noise that a fit feels: a step
    of one spacing is as a noise of 0.3 spacings. A regular grid in two axes (a height map) is none.
    """
    points = points[thinned(len(points), _LOOKED_AT)]
    distinct = len(np.unique(points, axis=0))
    if distinct < 2:
        return 0.0
    steps = quantisation_step(points) / (point_spacing(points) * np.sqrt(distinct / len(points)))
    widest = float(steps.max())
    varied = steps[np.ptp(points, axis=0) > 0]
    everywhere = len(varied) == 3 and varied.min() >= _COARSE_IN_ALL
    return widest if widest >= _COARSE_IN_ONE or everywhere else 0.0


def quantisation_step(points: Float[np.ndarray, "points 3"]) -> Float64[np.ndarray, "3"]:
    """The step between neighbouring values of each axis, in the input's unit; 0 where none is seen.

    `points` are finite, in the input's coordinates: normalised ones do not show what precision a file had, but
    ones that are taken back from them do. A step is seen in the values themselves, where they are few and evenly
    spaced, in their digits, or where all of them are numbers of half or single precision.
    """
    points = points[thinned(len(points), _LOOKED_AT)].astype(np.float64)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    largest = np.abs(points).max(axis=0)
    tolerance = _EQUAL * float(largest.max())
    gaps = [_gaps(values, tolerance) for values in points.T]
    regular = np.array([_regular_step(of_axis) for of_axis in gaps])
    varied = np.array([len(of_axis) > 0 for of_axis in gaps])
    sure = np.array([len(of_axis) >= _SURE_GAPS for of_axis in gaps]) | (largest > _FAR * size)
    if not regular[varied].all():
        regular[~sure] = 0  # a few even gaps in one axis are shelves, in all axes they are steps
    decimal = np.array([_decimal_step(values, size, tolerance) for values in points.T])
    if (decimal > 0).sum() < 2:
        decimal[:] = 0  # a flat cloud at a round height
    return np.maximum.reduce([regular, decimal, _precision_step(points, tolerance)])


def _gaps(values: Float64[np.ndarray, "points"], tolerance: float) -> Float64[np.ndarray, "gaps"]:
    gaps = np.diff(np.unique(values))
    return gaps[gaps > tolerance]


def _regular_step(gaps: Float64[np.ndarray, "gaps"]) -> float:
    """The step of which nearly all gaps are multiples; 0 where there is none."""
    if len(gaps) < 2:
        return 0.0
    step = float(np.median(gaps))
    counts = gaps / step
    regular = (np.abs(counts - np.round(counts)) < _REGULAR) & (counts > 0.5)
    return step if regular.mean() >= _REGULAR_SHARE else 0.0


def _decimal_step(values: Float64[np.ndarray, "points"], size: float, tolerance: float) -> float:
    """The largest power of ten that divides all values of an axis far from the origin; 0 where it is fine."""
    largest = float(np.abs(values).max())
    if largest <= _VERY_FAR * size:
        return 0.0
    for exponent in range(int(np.ceil(np.log10(largest))), int(np.floor(np.log10(size))) - 3, -1):
        step = 10.0**exponent
        if (np.abs(values - np.round(values / step) * step) <= tolerance).all():
            return step
    return 0.0


def _precision_step(points: Float64[np.ndarray, "points 3"], tolerance: float) -> Float64[np.ndarray, "3"]:
    """The step of half or single precision at each axis' largest value, where all values are such numbers."""
    for kind in (np.float16, np.float32):
        with np.errstate(over="ignore", invalid="ignore"):
            rounded = points.astype(kind)
            if (np.abs(points - rounded) <= tolerance).all():
                return np.spacing(np.abs(rounded).max(axis=0)).astype(np.float64)
    return np.zeros(3)
