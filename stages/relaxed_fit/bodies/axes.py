"""Axes that a body may turn about or slide along, read off its shape and its border."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from stages.kernels.alignment.oriented_cloud import OrientedCloud
from stages.kernels.kinematics.tree import joint_transforms
from stages.kernels.motion.rigid_motion import rotation_vectors
from stages.kernels.points.nearest import KDTree, nearest

SHARPNESS = 32  # power of |cos| with which normals count for a direction that they lie along
ALONG = 0.9  # |cos| of normals that a direction accounts for
SAME_DIRECTION, SAME_LINE = 0.998, 1.0  # |cos| and distance (spacings) below which two axes are one
OUTLIERS = 1.0  # percent of a body's points outside its box, on either side
LINES, LINE_DRAWS, LINE_WIDTH, SHORTEST_LINE = 3, 100, 1.5, 3.0  # of straight pieces of a border, in spacings
LEAST_ANGLE, LEAST_SLIDE = np.radians(4.0), 0.5  # of a motion that has an axis


@dataclass(frozen=True)
class Axes:
    """Axes by a point and a unit direction: of a turn where `turns`, else of a slide."""

    turns: Bool[np.ndarray, "axes"]
    points: Float64[np.ndarray, "axes 3"]
    directions: Float64[np.ndarray, "axes 3"]

    @classmethod
    def of(cls, found: Iterable[tuple[bool, np.ndarray, np.ndarray]]) -> Axes:
        """Axes given as (turns, point, direction), each once."""
        kept: list[tuple[bool, np.ndarray, np.ndarray]] = []
        for turns, point, direction in found:
            if not any(turns == other[0] and _same(point, direction, *other) for other in kept):
                kept.append((turns, point, direction))
        turns_, points, directions = zip(*kept, strict=True) if kept else ((), (), ())
        return cls(np.array(turns_, dtype=bool), np.reshape(points, (-1, 3)), np.reshape(directions, (-1, 3)))

    def __len__(self) -> int:
        return len(self.turns)

    def __add__(self, other: Axes) -> Axes:
        return Axes(
            np.concatenate([self.turns, other.turns]),
            np.concatenate([self.points, other.points]),
            np.concatenate([self.directions, other.directions]),
        )

    def transforms(self, axis: int, amounts: Float64[np.ndarray, "amounts"]) -> Float64[np.ndarray, "amounts 4 4"]:
        """The motions about or along one axis by some angles (radians) or lengths."""
        along = np.multiply.outer(amounts, self.directions[axis])
        zero = np.zeros_like(along)
        motions = np.concatenate([along, zero] if self.turns[axis] else [zero, along], axis=1)
        return joint_transforms(self.points[axis], motions)


def _same(
    point: np.ndarray, direction: np.ndarray, turns: bool, other_point: np.ndarray, other_direction: np.ndarray
) -> bool:
    if abs(direction @ other_direction) < SAME_DIRECTION:
        return False
    between = point - other_point
    return not turns or float(np.linalg.norm(between - (between @ other_direction) * other_direction)) < SAME_LINE


def axes_of_shape(body: OrientedCloud, border: Float64[np.ndarray, "border 3"], whole: OrientedCloud) -> Axes:
    """Axes of a body: through its box, along its border to the rest, and along the main directions of the whole.

    `border` holds the places where the body meets other surfaces.
    """
    found: list[tuple[bool, np.ndarray, np.ndarray]] = []
    centre = body.p.mean(axis=0)
    through = [centre] if len(border) == 0 else [border.mean(axis=0), centre]
    main = main_directions(whole)
    boxes = [np.linalg.eigh(np.cov(body.p.T))[1].T, main_directions(body)]
    for R in boxes:
        found += [(True, point, R[a]) for a, point in _box_lines(body.p, R)]
    found += [(True, *line) for line in _straight_pieces(border)]
    found += [(True, point, direction) for R in [*boxes, main] for point in through for direction in R]
    found += [(False, np.zeros(3), direction) for R in [*boxes, main] for direction in R]
    return Axes.of(found)


def main_directions(cloud: OrientedCloud) -> Float64[np.ndarray, "3 3"]:
    """Orthonormal rows: the direction along which most normals lie, the next one across it, and their product."""
    weights = cloud.flatness.copy()
    first = _strongest(cloud.normals, weights, np.eye(3))
    weights[np.abs(cloud.normals @ first) > ALONG] *= 1e-3
    second = _strongest(cloud.normals, weights, np.eye(3) - np.outer(first, first))
    return np.stack([first, second, np.cross(first, second)])


def _strongest(
    normals: Float64[np.ndarray, "points 3"], weights: Float64[np.ndarray, "points"], projection: np.ndarray
) -> Float64[np.ndarray, "3"]:
    """The unit direction, within a projection, along which the normals of most weight lie."""
    candidates = normals[np.argsort(-weights, kind="stable")[:400:4]] @ projection
    lengths = np.linalg.norm(candidates, axis=1)
    candidates = candidates[lengths > 0.5] / lengths[lengths > 0.5, None]
    if len(candidates) == 0:  # all normals lie across: any direction will do
        candidates = projection[[np.abs(np.diag(projection)).argmax()]]
        candidates = candidates / np.linalg.norm(candidates)
    strength = (np.abs(candidates @ normals.T) ** SHARPNESS * weights).sum(axis=1)
    direction = candidates[strength.argmax()]
    for _ in range(3):
        pull = weights * np.abs(normals @ direction) ** SHARPNESS
        direction = projection @ np.linalg.eigh((normals * pull[:, None]).T @ normals)[1][:, 2]
        direction = direction / np.linalg.norm(direction)
    return np.asarray(direction)


def _box_lines(p: Float64[np.ndarray, "points 3"], R: Float64[np.ndarray, "3 3"]) -> list[tuple[int, np.ndarray]]:
    """Lines along each side of a box with axes R: at its edges, through the middles of its faces, and its centre."""
    lowest, highest = np.percentile(p @ R.T, [OUTLIERS, 100 - OUTLIERS], axis=0)
    middle = (lowest + highest) / 2
    lines = []
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for at_b in (lowest[b], middle[b], highest[b]):
            for at_c in (lowest[c], middle[c], highest[c]):
                place = middle.copy()
                place[b], place[c] = at_b, at_c
                lines.append((a, R.T @ place))
    return lines


def _straight_pieces(border: Float64[np.ndarray, "border 3"]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Lines on which many places of the border lie, by drawing pairs of places (RANSAC); always the same."""
    rng, lines = np.random.default_rng(0), []
    for _ in range(LINES):
        if len(border) < 4:
            break
        first, second = border[rng.integers(len(border), size=(2, LINE_DRAWS))]
        lengths = np.linalg.norm(second - first, axis=1)
        long = lengths > SHORTEST_LINE
        if not long.any():
            break
        first, directions = first[long], (second - first)[long] / lengths[long, None]
        between = border - first[:, None]
        across = between - np.einsum("lni,li->ln", between, directions)[..., None] * directions[:, None]
        near = np.linalg.norm(across, axis=-1) < LINE_WIDTH
        on = near[near.sum(axis=1).argmax()]
        if on.sum() < 4:
            break
        centre = border[on].mean(axis=0)
        lines.append((centre, np.linalg.svd(border[on] - centre, full_matrices=False)[2][0]))
        border = border[~on]
    return lines


def axis_of_motion(T: Float64[np.ndarray, "4 4"]) -> tuple[bool, np.ndarray, np.ndarray] | None:
    """The axis that a rigid motion turns about, or slides along where it hardly turns; None where it does neither."""
    turn, shift = rotation_vectors(T[:3, :3]), T[:3, 3]
    angle, length = np.linalg.norm(turn), np.linalg.norm(shift)
    if angle < LEAST_ANGLE:
        return None if length < LEAST_SLIDE else (False, np.zeros(3), shift / length)
    axis = turn / angle
    across = shift - (shift @ axis) * axis
    return True, 0.5 * (across + np.cross(axis, across) / np.tan(angle / 2)), axis


def share_on_surface(axes: Axes, p: Float64[np.ndarray, "points 3"], near: float) -> Float64[np.ndarray, "axes"]:
    """The share of each axis, along the extent of the points, that runs within `near` of them. One for slides."""
    tree, shares = KDTree(p), np.ones(len(axes))
    for k in np.flatnonzero(axes.turns):
        point, direction = axes.points[k], axes.directions[k]
        along = (p - point) @ direction
        places = point + np.linspace(along.min(), along.max(), 20)[:, None] * direction
        shares[k] = (nearest(tree, places)[0] < near).mean()
    return shares
