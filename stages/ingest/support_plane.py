"""The plane that an object stands on: a table, or the floor around it.

Such a plane holds many points, all else lies on one side of it, and it sticks out beyond the object all around. The
last tells it from a flat side of the object, such as the door of a cabinet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from stages.kernels.points.nearest import KDTree

_SEEN = 4000  # points that planes are looked for among
_TRIED = 400  # planes
_FITTED = 30  # the planes with the most points among them, which differ
_PARALLEL = 0.97  # cosine of the angle between normals of planes that do not
_FITS = 5  # times that each is fitted to its points
_NEIGHBOURS = 30  # points that a plane is tried through
_FEWEST = 3  # points that a plane is fitted to
_REACH = 0.005  # least distance of a plane's points from it while it is looked for, as a share of the size
_DEVIATIONS = 4.0  # the same in the end, in standard deviations of the points' distances
_ONE_SIDE = 0.95  # least share of the other points that lies on one side
_MARGIN = 0.03  # of the outline, as a share of the size
_OUTLINE = 0.98  # share of the object's points within its outline in a direction, so that stray points do not matter
_DIRECTIONS = 24  # along the plane
_BEYOND = 0.01  # least share of the plane's points beyond the outline in a direction
_AROUND = 0.6  # least share of the directions in which there are so many

Points = Float64[np.ndarray, "points 3"]


@dataclass(frozen=True)
class Plane:
    """The points p with normal . p = offset. The object lies where that is greater."""

    normal: Float64[np.ndarray, "3"]
    offset: float

    def height(self, points: Points) -> Float64[np.ndarray, "points"]:
        """How high above the plane each point lies; negative below it."""
        height: Float64[np.ndarray, "points"] = points @ self.normal - self.offset
        return height


def above_support(points: Points, least_share: float, rng: np.random.Generator) -> Bool[np.ndarray, "points"]:
    """Which points lie above the plane that the object stands on. Without such a plane all do."""
    found = support_plane(points, least_share, rng)
    if found is None:
        return np.ones(len(points), dtype=bool)
    plane, reach = found
    return plane.height(points) > reach


def support_plane(points: Points, least_share: float, rng: np.random.Generator) -> tuple[Plane, float] | None:
    """The plane that the object stands on, and how far from it its points lie; None if there is none.

    Planes through neighbouring points are tried, those of the most points are fitted, and of those that hold
    `least_share` of all points and support the object the one with the most points is taken.
    """
    seen = points[np.sort(rng.permutation(len(points))[:_SEEN])]
    if len(seen) <= _NEIGHBOURS:
        return None
    low, high = np.quantile(seen, [0.01, 0.99], axis=0)
    size, centre = float(np.linalg.norm(high - low)), (low + high) / 2
    if size == 0:
        return None
    seen = seen - centre
    tried, noise = _local_planes(seen, rng.permutation(len(seen))[:_TRIED])
    reach = max(_REACH * size, 2 * noise)
    fitted = _largest(tried, seen, reach)
    found = [plane for plane in fitted if _count(plane, seen, reach) >= least_share * len(seen)]
    supports = [plane for plane in found if _supports(plane, seen, reach, size)]
    if not supports:
        return None
    best = max(supports, key=lambda plane: _count(plane, seen, reach))
    distance = np.abs(best.height(seen))
    spread = 1.4826 * float(np.median(distance[distance <= reach]))
    plane = Plane(best.normal, best.offset + float(best.normal @ centre))
    return plane, min(max(_DEVIATIONS * spread, 1e-6 * size), 2 * reach)


def _local_planes(seen: Points, chosen: Int64[np.ndarray, "chosen"]) -> tuple[list[Plane], float]:
    """The plane through the neighbours of each chosen point, and the median deviation of neighbours from theirs."""
    near = seen[KDTree(seen).query(seen[chosen], k=_NEIGHBOURS)[1]]
    middle = near.mean(axis=1)
    offsets = near - middle[:, None]
    variances, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets) / _NEIGHBOURS)
    planes = [Plane(normal, float(normal @ p)) for normal, p in zip(axes[:, :, 0], middle, strict=True)]
    return planes, float(np.sqrt(np.median(variances[:, 0].clip(0))))


def _largest(tried: list[Plane], seen: Points, reach: float) -> list[Plane]:
    """Fit those of the most points among different planes."""
    fitted: list[Plane] = []
    for plane in sorted(tried, key=lambda plane: -_count(plane, seen, reach)):
        if not any(_alike(plane, other, reach) for other in fitted):
            fitted.append(_fitted(plane, seen, reach))
        if len(fitted) == _FITTED:
            break
    return fitted


def _alike(plane: Plane, other: Plane, reach: float) -> bool:
    """Whether two planes are nearly the same where the first was found."""
    cosine = float(plane.normal @ other.normal)
    return abs(cosine) > _PARALLEL and abs(plane.offset - np.sign(cosine) * other.offset) < 2 * reach


def _count(plane: Plane, seen: Points, reach: float) -> int:
    return int((np.abs(plane.height(seen)) <= reach).sum())


def _fitted(plane: Plane, seen: Points, reach: float) -> Plane:
    """Fit a plane to its points. The object is where most other points are."""
    for _ in range(_FITS):
        own = seen[np.abs(plane.height(seen)) <= reach]
        if len(own) < _FEWEST:
            break
        middle = own.mean(axis=0)
        normal = np.linalg.eigh((own - middle).T @ (own - middle))[1][:, 0]
        plane = Plane(normal, float(normal @ middle))
    height = plane.height(seen)
    up = 1.0 if (height > reach).sum() >= (height < -reach).sum() else -1.0
    return Plane(up * plane.normal, up * plane.offset)


def _supports(plane: Plane, seen: Points, reach: float, size: float) -> bool:
    """Whether other points lie above a plane only, and it sticks out beyond them in most directions."""
    height = plane.height(seen)
    above, below = height > reach, height < -reach
    thing = height > 2 * reach
    if thing.sum() < _NEIGHBOURS or above.sum() < _ONE_SIDE * (above | below).sum():
        return False
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    along = np.linalg.svd(plane.normal[None])[2][1:]
    across = seen @ (np.stack([np.cos(angles), np.sin(angles)], axis=1) @ along).T
    outline = np.quantile(across[thing], _OUTLINE, axis=0) + _MARGIN * size
    beyond = (across[~above & ~below] > outline).mean(axis=0)
    return float((beyond >= _BEYOND).mean()) >= _AROUND
