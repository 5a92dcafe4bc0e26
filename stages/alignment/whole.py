"""Motions of one scan onto another, whatever the coordinates of either: of the largest body that fits.

Lengths are in spacings. A share is that of the points which a motion explains, weighted by how well it does.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from jaxtyping import Float64

from stages.alignment.correlation import correlated_motions
from stages.alignment.rotations import even_rotations, upright_rotations
from stages.kernels.alignment.fit_cost import fit_costs, refine_motions
from stages.kernels.alignment.oriented_cloud import OrientedCloud
from stages.kernels.motion.rigid_motion import inverse, move_points
from stages.kernels.points.sampling import farthest_points

CORRELATED_POINTS, FEW_POINTS, MORE_POINTS = 1200, 350, 900
COARSE = 600, 20, 32, 2, 60  # rotations, cells in a diagonal, cells of the grid, peaks, kept
UPRIGHT = 36, 32, 64, 3, 48
REACHES, LAST_REACHES = (6.0, 6.0, 5.0, 4.5, 4.0, 3.5, 3.0, 2.5, 2.0, 2.0), (2.0, 1.5, 1.5, 1.2, 1.2)
DISTINCT = 1.5  # mean distance, in spacings, between different motions
KEPT = 10


@cache
def _rotations() -> tuple[tuple[Float64[np.ndarray, "rotations 3 3"], tuple[int, int, int, int]], ...]:
    """Rotations to try, with the grid that suits them: all orientations coarsely, turns of upright scans finely."""
    return ((even_rotations(COARSE[0]), COARSE[1:]), (upright_rotations(UPRIGHT[0]), UPRIGHT[1:]))


def whole_motions(
    source: OrientedCloud, target: OrientedCloud, diagonal: float
) -> tuple[Float64[np.ndarray, "motions 4 4"], Float64[np.ndarray, "motions"]]:
    """Distinct motions from the source to the target, best first, and their shares: the mean of both directions."""
    thin, thin_target = (cloud.take(farthest_points(cloud.p, CORRELATED_POINTS)) for cloud in (source, target))
    starts = []
    for rotations, (resolution, cells, peaks, kept) in _rotations():
        Ts, correlations = correlated_motions(thin, thin_target, rotations, diagonal / resolution, cells, peaks)
        starts.append(Ts[np.argsort(-correlations, kind="stable")[:kept]])
    few = source.take(farthest_points(source.p, FEW_POINTS))
    Ts = refine_motions(target, few, np.concatenate(starts), REACHES)
    order = np.argsort(fit_costs(target, few, Ts)[0].mean(axis=1), kind="stable")
    Ts = Ts[distinct(Ts[order], few.p, KEPT, order.tolist())]
    Ts = refine_motions(target, source.take(farthest_points(source.p, MORE_POINTS)), Ts, LAST_REACHES)
    shares = np.array([shared(source, target, T) for T in Ts])
    order = np.argsort(-shares, kind="stable")
    return Ts[order], shares[order]


def distinct(
    Ts: Float64[np.ndarray, "motions 4 4"], p: Float64[np.ndarray, "points 3"], most: int, names: Sequence[int]
) -> list[int]:
    """The names of the first `most` motions that differ from each other."""
    kept: list[tuple[int, np.ndarray]] = []
    for name, T in zip(names, Ts, strict=True):
        moved = move_points(T, p)
        if all(np.linalg.norm(moved - other, axis=1).mean() > DISTINCT for _, other in kept):
            kept.append((name, moved))
        if len(kept) == most:
            break
    return [name for name, _ in kept]


def shared(source: OrientedCloud, target: OrientedCloud, T: Float64[np.ndarray, "4 4"]) -> float:
    """The share of both clouds that a motion explains."""
    forth = source.take(farthest_points(source.p, MORE_POINTS))
    back = target.take(farthest_points(target.p, MORE_POINTS))
    costs = fit_costs(target, forth, T[None])[0].mean() + fit_costs(source, back, inverse(T)[None])[0].mean()
    return float(1.0 - costs / 2)
