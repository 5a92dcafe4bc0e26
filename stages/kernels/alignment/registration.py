"""Registration of rigid groups of points to all frames at once, by Gauss-Newton on robust plane distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.alignment.visibility import UNSEEN_COST, Exposure, View, sum_of_seen
from stages.kernels.motion.rigid_motion import from_parts, inverse, move_points, rotations
from stages.kernels.points.nearest import KDTree, nearest, neighbours
from stages.kernels.points.sampling import normals, point_spacing

POINT_TO_POINT = 0.1  # weight of the plain squared distance beside the squared plane distance
FRAME_PLANE_SPREAD = 0.4  # of plane distances to one frame, in spacings, where a model fits
TRUNCATION = 9.0  # most that a point can cost in one frame: three spreads
DAMPING = 1e-4
CLOSE = 2.0  # spacings from a frame's nearest point within which a place is not asked whether it is hidden
SPARSER = 1.5  # a frame whose spacing is so many times the canonical one's has a unit of length of its own


@dataclass(frozen=True)
class NormalEquations:
    """What the data say of every part's motion in every frame: their robust cost, and its quadratic model in twists.

    Twists turn about `centres`, the parts' own centres where they lie in each frame: angles in radians, lengths in
    spacings. Nothing is said of the canonical frame.
    """

    cost: float
    hessian: Float64[np.ndarray, "frames parts 6 6"]
    gradient: Float64[np.ndarray, "frames parts 6"]
    centres: Float64[np.ndarray, "frames parts 3"]


@dataclass(frozen=True)
class Pairs:
    """Pairs of a canonical point, posed by its part's motion, and a point of one frame.

    First each canonical point with its nearest one of the frame, in their order, then each point of the frame with the
    nearest canonical one. `p` is the posed canonical point of each pair and `normal` that of the frame's surface.
    `offset` leads from the frame's point to the posed one, in spacings. `distance` is in the frame's own spacings.
    `tells` is how much it says where the two are far apart: nothing where one side is hidden in the other one's frame.
    """

    source: Int64[np.ndarray, "pairs"]
    target: Int64[np.ndarray, "pairs"]
    p: Float64[np.ndarray, "pairs 3"]
    normal: Float64[np.ndarray, "pairs 3"]
    offset: Float64[np.ndarray, "pairs 3"]
    distance: Float64[np.ndarray, "pairs"]
    tells: Float64[np.ndarray, "pairs"]


class Registration:
    """A canonical cloud against the other frames of a sequence.

    Groups are sets of canonical points, given as parallel arrays `index` (entries,) of points and `group`
    (entries,) of group numbers; groups may overlap. Each group moves by `Ts` (frames, groups, 4, 4).
    Lengths inside are in units of `spacing`, the canonical cloud's. Distances in a far sparser frame are in units of
    that frame's own spacing (`spacings`), since its points are that far off however well they fit.

    `views` say of each frame what could be seen in it: what could not says nothing of the motion there. They are known
    where the cameras' places are (`viewpoints`).
    """

    def __init__(
        self,
        frames: Sequence[Float64[np.ndarray, "points 3"]],
        canonical_frame: int,
        truncation: float = TRUNCATION,
        viewpoints: Float64[np.ndarray, "frames cameras 3"] | None = None,
    ) -> None:
        self.truncation = truncation
        self.p = frames[canonical_frame]
        self.spacing = point_spacing(self.p)
        spacings = np.array([point_spacing(frame) for frame in frames])
        self.spacings = np.where(spacings > SPARSER * self.spacing, spacings, self.spacing)
        self.shares = (self.spacing / self.spacings) ** 2  # of what a frame as dense as the canonical one would tell
        self.others = [t for t in range(len(frames)) if t != canonical_frame]
        self.frames = frames
        self.trees = [KDTree(frame) for frame in frames]
        self._normals = [normals(frame) for frame in frames]
        self.canonical_frame = canonical_frame
        self.views: Sequence[View | Exposure] | None = None
        if viewpoints is not None:
            seen = zip(frames, viewpoints, self.spacings, strict=True)
            self.views = [View.of(frame, p_cameras, spacing) for frame, p_cameras, spacing in seen]

    @property
    def evidence(self) -> float:
        """How many frames as dense as the canonical one tell as much as the others: a sparser one counts for less."""
        return float(self.shares[self.others].sum())

    def cost(
        self,
        index: Int64[np.ndarray, "entries"],
        group: Int64[np.ndarray, "entries"],
        Ts: Float64[np.ndarray, "frames groups 4 4"],
    ) -> Float64[np.ndarray, "entries"]:
        """How badly each point's motion is borne out, averaged over frames.

        In a frame: the squared plane distance in units of its spread plus half the squared point distance in
        spacings, truncated. Frames that hide the point are taken to cost what the others let one expect.
        """
        costs, hidden = np.empty((len(self.others), len(index))), np.zeros((len(self.others), len(index)), dtype=bool)
        for slot, t in enumerate(self.others):
            p, target, distance = self._matches(t, index, group, Ts)
            tells = self.tells(t, p, distance)
            offset = (p - self.frames[t][target]) / self.spacings[t]
            costs[slot] = _match_cost(self._normals[t][target], offset, distance, self.truncation * tells)
            hidden[slot] = tells == 0
        return sum_of_seen(costs, hidden, 0) / len(self.others)

    def cost_back(self, labels: Int64[np.ndarray, "points"], Ts: Float64[np.ndarray, "frames parts 4 4"]) -> float:
        """How badly the posed model bears out the frames' points: `cost` the other way round, in sum.

        Points that the canonical frame hides cost nothing.
        """
        total = 0.0
        for t in self.others:
            p = move_points(Ts[t, labels], self.p)
            distance, source = nearest(KDTree(p), self.frames[t])
            distance = distance / self.spacings[t]
            offset = (p[source] - self.frames[t]) / self.spacings[t]
            most = self.truncation * self._tells_before(t, labels[source], Ts, distance)
            total += _match_cost(self._normals[t], offset, distance, most).sum()
        return float(total / len(self.others))

    def place_costs(self, t: int, p: Float64[np.ndarray, "places 3"]) -> Float64[np.ndarray, "places"]:
        """What it costs that there is a point at each of some places of frame t; `UNSEEN_COST` where it hides them."""
        distance, target = nearest(self.trees[t], p)
        distance = distance / self.spacings[t]
        tells = self.tells(t, p, distance)
        offset = (p - self.frames[t][target]) / self.spacings[t]
        costs = _match_cost(self._normals[t][target], offset, distance, self.truncation * tells)
        return np.where(tells == 0, UNSEEN_COST, costs)

    def tells(
        self, t: int, p: Float64[np.ndarray, "entries 3"], distance: Float64[np.ndarray, "entries"]
    ) -> Float64[np.ndarray, "entries"]:
        """How much it says of places that frame t is empty there, given how far its nearest point is, in spacings.

        That is 1 where nobody knows what was seen, and 0 where the frame hides a place.
        """
        tells = np.ones(len(p))
        if self.views is not None:
            far = np.flatnonzero(distance > CLOSE)
            tells[far] = self.views[t].tells(p[far])
        return tells

    def _tells_before(
        self,
        t: int,
        part: Int64[np.ndarray, "target_points"],
        Ts: Float64[np.ndarray, "frames parts 4 4"],
        distance: Float64[np.ndarray, "target_points"],
    ) -> Float64[np.ndarray, "target_points"]:
        """How much it says that the canonical frame lacks points of frame t, were they points of the given parts."""
        if self.views is None:
            return np.ones(len(part))
        return self.tells(self.canonical_frame, move_points(inverse(Ts[t])[part], self.frames[t]), distance)

    def refine_groups(
        self,
        index: Int64[np.ndarray, "entries"],
        group: Int64[np.ndarray, "entries"],
        Ts: Float64[np.ndarray, "frames groups 4 4"],
        iterations: int,
        reach: float,
    ) -> Float64[np.ndarray, "frames groups 4 4"]:
        """Each group registered by itself, from its points to their nearest ones in every frame."""
        Ts, groups = Ts.copy(), Ts.shape[1]
        centres = group_means(self.p[index], group, groups)
        for _ in range(iterations):
            for t in self.others:
                p, target, distance = self._matches(t, index, group, Ts)
                p_centres = move_points(Ts[t], centres)
                hessian, gradient = normal_equations(
                    (p - p_centres[group]) / self.spacing,
                    group,
                    groups,
                    self._normals[t][target],
                    (p - self.frames[t][target]) / self.spacing,
                    self.shares[t] * robust_weight(distance, reach) * self.tells(t, p, distance),
                )
                hessian += DAMPING * _scaled_identity(hessian)
                twists = -np.linalg.solve(hessian, gradient[..., None])[..., 0]
                Ts[t] = turn_about(p_centres, twists, self.spacing) @ Ts[t]
        return Ts

    def refine_parts(
        self,
        labels: Int64[np.ndarray, "points"],
        Ts: Float64[np.ndarray, "frames parts 4 4"],
        touching: Int64[np.ndarray, "touching 2"],
        iterations: int,
        reach: float,
        attachment: float,
    ) -> Float64[np.ndarray, "frames parts 4 4"]:
        """All parts registered together, both from model to frame and from frame to model.

        `touching` are pairs of neighbouring points of different parts; the places between them are asked,
        with weight `attachment` and robustly, to move alike by both parts' motions. Without it round parts
        would be free to slide and turn on themselves.
        """
        Ts, parts = Ts.copy(), Ts.shape[1]
        middles = self.p[touching].mean(axis=1)
        sides = labels[touching].T
        for _ in range(iterations):
            equations = self.linearise(labels, Ts, reach)
            for t in self.others:
                hessian = np.zeros((parts, parts, 6, 6))
                hessian[np.arange(parts), np.arange(parts)] = equations.hessian[t]
                gradient, centres = equations.gradient[t], equations.centres[t]
                self._attach(hessian, gradient, middles, sides, Ts[t], centres, reach, attachment)
                matrix = hessian.transpose(0, 2, 1, 3).reshape(6 * parts, 6 * parts)
                matrix[np.diag_indices_from(matrix)] += 1e-3 + DAMPING * matrix.diagonal()
                twists = -np.linalg.solve(matrix, gradient.ravel()).reshape(parts, 6)
                Ts[t] = turn_about(centres, twists, self.spacing) @ Ts[t]
        return Ts

    def linearise(
        self, labels: Int64[np.ndarray, "points"], Ts: Float64[np.ndarray, "frames parts 4 4"], reach: float
    ) -> NormalEquations:
        """Matches from model to frame and from frame to model, and what they say of each part's motion."""
        frames, parts = Ts.shape[:2]
        own_centres = group_means(self.p, labels, parts)
        hessian, gradient = np.zeros((frames, parts, 6, 6)), np.zeros((frames, parts, 6))
        centres = np.stack([move_points(T, own_centres) for T in Ts])
        cost = 0.0
        for t in self.others:
            pairs = self.pairs(t, labels, Ts)
            part, share = labels[pairs.source], self.shares[t]
            arms = (pairs.p - centres[t, part]) / self.spacing
            weight = robust_weight(pairs.distance, reach) * pairs.tells
            hessian[t], gradient[t] = normal_equations(arms, part, parts, pairs.normal, pairs.offset, share * weight)
            squares = share * np.einsum("ni,ni->n", pairs.normal, pairs.offset) ** 2
            cost += float(((squares + POINT_TO_POINT * pairs.distance**2) * np.sqrt(weight)).sum())
        return NormalEquations(cost, hessian, gradient, centres)

    def pairs(self, t: int, labels: Int64[np.ndarray, "points"], Ts: Float64[np.ndarray, "frames parts 4 4"]) -> Pairs:
        """Matches of the posed model and frame t, both ways."""
        index = np.arange(len(self.p))
        p, target, distance = self._matches(t, index, labels, Ts)
        back_distance, back = nearest(KDTree(p), self.frames[t])
        back_distance = back_distance / self.spacings[t]
        tells = [self.tells(t, p, distance), self._tells_before(t, labels[back], Ts, back_distance)]
        source = np.concatenate([index, back])
        target = np.concatenate([target, np.arange(len(back))])
        distance = np.concatenate([distance, back_distance])
        p = p[source]
        normal, offset = self._normals[t][target], (p - self.frames[t][target]) / self.spacing
        return Pairs(source, target, p, normal, offset, distance, np.concatenate(tells))

    def pair_costs(self, t: int, pairs: Pairs) -> Float64[np.ndarray, "pairs"]:
        """What each pair of frame t costs, as `cost` counts it."""
        offset = pairs.offset * (self.spacing / self.spacings[t])
        return _match_cost(pairs.normal, offset, pairs.distance, self.truncation * pairs.tells)

    def own_costs(self, t: int) -> Float64[np.ndarray, "points"]:
        """What the points of frame t cost against the nearest other one of the same frame.

        Another sample of the same surface, with the same noise, costs as much.
        """
        distances, indices = neighbours(self.frames[t], 1)
        offset = (self.frames[t] - self.frames[t][indices[:, 0]]) / self.spacings[t]
        return _match_cost(self._normals[t][indices[:, 0]], offset, distances[:, 0] / self.spacings[t], self.truncation)

    def _matches(
        self, t: int, index: np.ndarray, group: np.ndarray, Ts: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Moved points, their nearest in frame t, and the distance to it in that frame's spacings."""
        T_points = Ts[t, group]
        p = move_points(T_points, self.p[index])
        distance, target = nearest(self.trees[t], p)
        return p, target, distance / self.spacings[t]

    def _attach(
        self,
        hessian: Float64[np.ndarray, "parts parts 6 6"],
        gradient: Float64[np.ndarray, "parts 6"],
        middles: Float64[np.ndarray, "touching 3"],
        sides: Int64[np.ndarray, "2 touching"],
        Ts: Float64[np.ndarray, "parts 4 4"],
        p_centres: Float64[np.ndarray, "parts 3"],
        reach: float,
        attachment: float,
    ) -> None:
        """Add the pull of touching points, in place."""
        a, b = sides
        p_a, p_b = move_points(Ts[a], middles), move_points(Ts[b], middles)
        gap = (p_a - p_b) / self.spacing
        weight = attachment * robust_weight(np.linalg.norm(gap, axis=1), reach)
        jacobians = (
            (a, twist_jacobian((p_a - p_centres[a]) / self.spacing)),
            (b, -twist_jacobian((p_b - p_centres[b]) / self.spacing)),
        )
        for row, left in jacobians:
            np.add.at(gradient, row, np.einsum("nia,n,ni->na", left, weight, gap))
            for column, right in jacobians:
                np.add.at(hessian, (row, column), np.einsum("nia,n,nib->nab", left, weight, right))


def twist_jacobian(arms: Float64[np.ndarray, "*batch 3"]) -> Float64[np.ndarray, "*batch 3 6"]:
    """d(arm moved by a twist)/d(twist) = [-skew(arm), I]."""
    jacobian = np.zeros((*arms.shape, 6))
    jacobian[..., 0, 1], jacobian[..., 0, 2] = arms[..., 2], -arms[..., 1]
    jacobian[..., 1, 0], jacobian[..., 1, 2] = -arms[..., 2], arms[..., 0]
    jacobian[..., 2, 0], jacobian[..., 2, 1] = arms[..., 1], -arms[..., 0]
    jacobian[..., 0, 3] = jacobian[..., 1, 4] = jacobian[..., 2, 5] = 1.0
    return jacobian


def turn_about(
    centres: Float64[np.ndarray, "groups 3"], twists: Float64[np.ndarray, "groups 6"], spacing: float
) -> Float64[np.ndarray, "groups 4 4"]:
    """Transforms of twists taken about given centres; angles in radians, lengths in spacings."""
    R = rotations(twists[:, :3])
    return from_parts(R, centres - np.einsum("nij,nj->ni", R, centres) + twists[:, 3:] * spacing)


def normal_equations(
    arms: Float64[np.ndarray, "entries 3"],
    group: Int64[np.ndarray, "entries"],
    groups: int,
    normal: Float64[np.ndarray, "entries 3"],
    offset: Float64[np.ndarray, "entries 3"],
    weight: Float64[np.ndarray, "entries"],
) -> tuple[Float64[np.ndarray, "groups 6 6"], Float64[np.ndarray, "groups 6"]]:
    """Hessian and gradient of each group's twist for plane distances and, lightly, point distances.

    With J = [-skew(arm), I], the point distances' share follows from the moments of (arm, 1) and the offsets.
    """
    by_group = np.argsort(group, kind="stable")
    bounds = np.searchsorted(group[by_group], np.arange(groups + 1))
    root = np.sqrt(weight)[:, None]
    along = (root * np.concatenate([np.cross(arms, normal), normal], axis=1))[by_group]
    distance = (root[:, 0] * np.einsum("ni,ni->n", normal, offset))[by_group]
    lever = (root * np.concatenate([arms, np.ones((len(arms), 1))], axis=1))[by_group]
    pull = (root * offset)[by_group]
    hessian, gradient = np.empty((groups, 6, 6)), np.empty((groups, 6))
    moments, pulls = np.empty((groups, 4, 4)), np.empty((groups, 4, 3))
    for k in range(groups):
        own = slice(bounds[k], bounds[k + 1])
        hessian[k], gradient[k] = along[own].T @ along[own], along[own].T @ distance[own]
        moments[k], pulls[k] = lever[own].T @ lever[own], lever[own].T @ pull[own]
    second, mass = moments[:, :3, :3], moments[:, 3, 3, None, None]
    turn = twist_jacobian(moments[:, :3, 3])[..., :3]  # minus the skew matrix of the arms' sum
    inertia = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second
    upper = np.concatenate([inertia, turn.transpose(0, 2, 1)], axis=2)
    lower = np.concatenate([turn, mass * np.eye(3)], axis=2)
    hessian += POINT_TO_POINT * np.concatenate([upper, lower], axis=1)
    torque = np.stack([pulls[:, i, j] - pulls[:, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)
    gradient += POINT_TO_POINT * np.concatenate([torque, pulls[:, 3]], axis=1)
    return hessian, gradient


def _match_cost(
    normal: Float64[np.ndarray, "entries 3"],
    offset: Float64[np.ndarray, "entries 3"],
    distance: Float64[np.ndarray, "entries"],
    truncation: float | Float64[np.ndarray, "entries"],
) -> Float64[np.ndarray, "entries"]:
    plane = np.einsum("ni,ni->n", normal, offset) / FRAME_PLANE_SPREAD
    return np.minimum(plane**2 + 0.5 * distance**2, truncation)


def _scaled_identity(hessian: Float64[np.ndarray, "groups 6 6"]) -> Float64[np.ndarray, "groups 6 6"]:
    return np.eye(6) * (10.0 + np.trace(hessian, axis1=1, axis2=2) / 6)[:, None, None]


def robust_weight(distance: Float64[np.ndarray, "entries"], reach: float) -> Float64[np.ndarray, "entries"]:
    """Geman-McClure: matches much farther apart than `reach` hardly count."""
    return 1.0 / (1.0 + (distance / reach) ** 2) ** 2


def group_means(p: np.ndarray, group: np.ndarray, groups: int) -> Float64[np.ndarray, "groups 3"]:
    counts = np.maximum(np.bincount(group, minlength=groups), 1)
    return sum_groups(p, group, groups) / counts[:, None]


def sum_groups(values: np.ndarray, group: np.ndarray, groups: int) -> np.ndarray:
    """The sum over each group's rows of (rows, columns) values: (groups, columns)."""
    return np.stack([np.bincount(group, column, minlength=groups) for column in values.T], axis=1)
