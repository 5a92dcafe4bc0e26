"""How sure a fitted model is of each joint: what the best other explanation of the same points would cost more."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64, Int64

from schemas.config import FinalFitConfig
from stages.final_fit.working import Fit, Frames, relative_motions
from stages.kernels.alignment.evidence import FUSED_PLANE_SPREAD, motion_cost
from stages.kernels.kinematics.closed_form import JointFit, fit_joints
from stages.kernels.kinematics.tree import KinematicTree
from stages.kernels.motion.rigid_motion import inverse
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points

FREE_STEPS = 3  # registration steps of parts without their joints
USUAL_PRICE = FinalFitConfig().part_price  # where parts have no price
REFITTED = 0.1  # share of the rise by best joints that is left when all is refitted, on robots, about
SURE = 5.0  # prices from which on a rise is not looked into further
CLEARLY_WORSE = 1.0  # spacings by which another parent is worse where a link is 1 - 1/e sure


def joint_confidence(
    fit: Fit, frames: Frames, price: float, coarseness: float = 0.0
) -> Float64[np.ndarray, "joints 3"]:
    """Three numbers in [0, 1] for each joint: `part`, `link` and `type` (KinematicModel.confidence).

    A rise of the points' costs becomes 1 - exp(-rise / price): no rise is 0, and several prices are nearly 1. A link
    is doubted where another parent would do, or where its parts' points would rather move freely than by their joints.
    Where coordinates lie on steps of `coarseness` spacings, a difference of costs or distances counts by the noise that
    these steps are.
    """
    blur = _blur(coarseness)
    price = (price or USUAL_PRICE) * blur
    if len(fit.chain.tree.child) == 0:
        return np.zeros((0, 3))
    rivals = Rivals(fit, frames, price)
    one_dof = np.exp(-rivals.pulled / price)
    part = _certainty(rivals.part_rises(), price)
    link = one_dof * _certainty(rivals.link_margins(), CLEARLY_WORSE * np.sqrt(blur))
    if coarseness > 0:  # and so blurred, no motion is told to have more degrees of freedom than one
        link = np.minimum(link, part)
    return np.stack([part, link, _certainty(rivals.type_rises(), price)], axis=1)


def _blur(coarseness: float) -> float:
    """By how much steps of so many spacings raise the squared spread of plane distances; 1 where there are none."""
    return 1.0 + (coarseness / np.sqrt(12) / FUSED_PLANE_SPREAD) ** 2


def _certainty(rise: Float64[np.ndarray, "joints"], price: float) -> Float64[np.ndarray, "joints"]:
    return -np.expm1(-np.maximum(rise, 0.0) / price)


@dataclass(frozen=True)
class Rivals:
    """Other explanations of a fit's points, each compared with the fit by what it costs more.

    Costs are those that points are labelled by (motion_cost). Other explanations are not refitted.
    """

    fit: Fit
    frames: Frames
    price: float

    @property
    def tree(self) -> KinematicTree:
        return self.fit.chain.tree

    @property
    def Ts(self) -> Float64[np.ndarray, "frames parts 4 4"]:
        return self.fit.chain.Ts

    @cached_property
    def costs(self) -> Float64[np.ndarray, "points"]:
        """The cost of every point by the fit."""
        return self._costs(np.arange(len(self.fit.labels)), self.fit.labels, self.Ts)

    @cached_property
    def samples(self) -> Float64[np.ndarray, "parts count 3"]:
        """Well spread points of each part, at which its motion is judged; any points for a part that has none."""
        samples, count = [], self.frames.config.joint_samples
        for part in range(self.tree.parts):
            members = self.frames.p[self.fit.labels == part]
            members = members if len(members) else self.frames.p
            samples.append(members[np.resize(farthest_points(members, count), count)])
        return np.stack(samples)

    @cached_property
    def linked(self) -> Bool[np.ndarray, "parts parts"]:
        """Which parts a joint links."""
        linked = np.zeros((self.tree.parts, self.tree.parts), dtype=bool)
        linked[self.tree.parent, self.tree.child] = linked[self.tree.child, self.tree.parent] = True
        return linked

    @cached_property
    def joint_between(self) -> Int64[np.ndarray, "parts parts"]:
        """The joint that links two parts; -1 where none does."""
        between = np.full((self.tree.parts, self.tree.parts), -1)
        ends = self.tree.parent, self.tree.child
        between[ends] = between[ends[::-1]] = np.arange(len(self.tree.child))
        return between

    @property
    def pulled(self) -> Float64[np.ndarray, "joints"]:
        """What the points of either part of a joint, the more of the two, cost less when parts move freely."""
        points, labels = np.arange(len(self.fit.labels)), self.fit.labels
        registration = self.frames.registration
        Ts_free = registration.refine_groups(points, labels, self.Ts, FREE_STEPS, self.frames.reach)
        free_costs = self._costs(points, labels, Ts_free)
        fall = np.maximum(self._part_sums(self.costs) - self._part_sums(free_costs), 0.0)
        return fall[np.stack([self.tree.parent, self.tree.child])].max(axis=0)

    def part_rises(self) -> Float64[np.ndarray, "joints"]:
        """What points would cost more if either end of a joint were not a part of its own.

        Either it is one with the other end, or it is a piece of another, larger part that is linked to it.
        """
        parent, child = self.tree.parent, self.tree.child
        counts = np.bincount(self.fit.labels, minlength=self.tree.parts)
        rises = self._joining_rises()
        rises += REFITTED * self._rehanging_rises(rises < SURE * self.price)
        swallowed = np.where(counts[:, None] < counts, rises, np.inf)
        across = np.minimum(rises[parent, child], rises[child, parent])
        return np.minimum(across, np.minimum(swallowed[parent].min(axis=1), swallowed[child].min(axis=1)))

    def link_margins(self) -> Float64[np.ndarray, "joints"]:
        """By how many spacings the second best parent is worse: farther off, or two degrees of freedom away."""
        joint, other = np.nonzero(~self.tree.moves)  # whatever hangs on a child cannot be its parent
        child = self.tree.child[joint]
        left = self._refitted(joint, other, child).rms / self.frames.spacing
        distance = self._gaps()[other, child] + left
        own = other == self.tree.parent[joint]
        second = np.full(len(self.tree.child), np.inf)
        np.minimum.at(second, joint[~own], distance[~own])
        margins = second.copy()
        margins[joint[own]] -= distance[own]
        return margins

    def type_rises(self) -> Float64[np.ndarray, "joints"]:
        """What all that a joint moves would cost more if it were the best joint of another kind."""
        parts = self.tree.parts
        joint, point = np.nonzero(self.tree.moves[:, self.fit.labels])
        group = joint * parts + self.fit.labels[point]
        used, group = np.unique(group, return_inverse=True)
        carrier, carried = np.divmod(used, parts)
        Ts_moved = self._displacements()[:, carrier] @ self.Ts[:, carried]
        rise = self._costs(point, group, Ts_moved) - self.costs[point]
        return np.bincount(joint, rise, minlength=len(self.tree.child))

    def _joining_rises(self) -> Float64[np.ndarray, "parts parts"]:
        """What a part's points (rows) would cost more with the motion of another (columns); infinite if not linked."""
        parts, labels = self.tree.parts, self.fit.labels
        points, other = np.nonzero(self.linked[labels])
        rise = self._costs(points, other, self.Ts) - self.costs[points]
        sums = np.bincount(labels[points] * parts + other, rise, minlength=parts**2).reshape(parts, parts)
        return np.where(self.linked, sums, np.inf)

    def _rehanging_rises(self, asked: Bool[np.ndarray, "parts parts"]) -> Float64[np.ndarray, "parts parts"]:
        """What the others linked to a part (rows) would cost more if they hung on one of them (columns).

        A round link's own points tell nothing of its turning, but what hangs on it does.
        """
        part, into, other = np.nonzero(asked[:, :, None] & self.linked[:, None, :])
        part, into, other = (index[into != other] for index in (part, into, other))
        rises = np.zeros(asked.shape)
        if len(part):
            fits = self._refitted(self.joint_between[part, other], into, other)
            Ts_other = self.Ts[:, into] @ fits.since(self.frames.canonical_frame).transforms().swapaxes(0, 1)
            case, point = np.nonzero(other[:, None] == self.fit.labels)
            rise = self._costs(point, case, Ts_other) - self.costs[point]
            np.add.at(rises, (part, into), np.bincount(case, rise, minlength=len(part)))
        return np.maximum(rises, 0.0)

    def _displacements(self) -> Float64[np.ndarray, "frames joints 4 4"]:
        """How what a joint moves is displaced in each frame when it becomes the best joint of another kind."""
        parent, child = self.tree.parent, self.tree.child
        motions = relative_motions(self.Ts, parent, child)
        kinds = [tuple(other for other in self.frames.kinds if other != kind) or (kind,) for kind in self.tree.kinds]
        fits = fit_joints(kinds, motions, self.samples[child]).since(self.frames.canonical_frame)
        T_parent_child = fits.transforms()
        return self.Ts[:, parent] @ T_parent_child.swapaxes(0, 1) @ inverse(self.Ts[:, child])

    def _refitted(
        self, joint: Int64[np.ndarray, "cases"], parent: Int64[np.ndarray, "cases"], child: Int64[np.ndarray, "cases"]
    ) -> JointFit:
        """The best joints, of kinds like those of some joints of the fit, between other parts."""
        kinds = [self.frames.kinds_like(self.tree.kinds[one]) for one in joint]
        return fit_joints(kinds, relative_motions(self.Ts, parent, child), self.samples[child])

    def _gaps(self) -> Float64[np.ndarray, "parts parts"]:
        """The least distance of every two parts' points, in spacings beyond contact; unseen parts are anywhere."""
        frames = self.frames
        members = [frames.p[self.fit.labels == part] for part in range(self.tree.parts)]
        trees = [KDTree(p) if len(p) else None for p in members]
        gaps = np.zeros((len(members), len(members)))
        for a, tree in enumerate(trees):
            for b in range(a):
                if tree is not None and len(members[b]):
                    least = nearest(tree, members[b])[0].min() / frames.spacing
                    gaps[a, b] = gaps[b, a] = max(least - frames.config.contact, 0.0)
        return gaps

    def _part_sums(self, costs: Float64[np.ndarray, "points"]) -> Float64[np.ndarray, "parts"]:
        return np.bincount(self.fit.labels, costs, minlength=self.tree.parts)

    def _costs(
        self,
        points: Int64[np.ndarray, "points"],
        group: Int64[np.ndarray, "points"],
        Ts: Float64[np.ndarray, "frames groups 4 4"],
    ) -> Float64[np.ndarray, "points"]:
        """Chosen points' costs, each with the motion of its group."""
        return motion_cost(self.frames.registration, self.frames.p, points, group, Ts)
