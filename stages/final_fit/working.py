"""The final fit's working state: a model on the points that the fit works on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from schemas.config import FinalFitConfig
from schemas.joints import PRISMATIC, REVOLUTE, JointKind, parents_first
from schemas.kinematic import KinematicModel
from schemas.sequence import PointSequence
from stages.kernels.alignment.carry_over import seen_from
from stages.kernels.alignment.evidence import price_over, views_from_outside
from stages.kernels.alignment.registration import Registration
from stages.kernels.kinematics.chain import Chain, Joint, fit_chain
from stages.kernels.kinematics.closed_form import fit_joint, nearest_point_to_origin
from stages.kernels.motion.rigid_motion import inverse, move_points
from stages.kernels.points.contact import next_to_contact
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points, working_points
from stages.projection.stage import part_samples


@dataclass(frozen=True)
class Fit:
    """A tree of joints, and the part of every working point. Parts that no point shows have no labels."""

    chain: Chain
    labels: Int64[np.ndarray, "points"]


@dataclass(frozen=True)
class Frames:
    """The clouds that a fit works on, against each other, and the kinds of joints that it may choose.

    `index` are the canonical points among all, `p_all`.
    """

    registration: Registration
    p_all: Float64[np.ndarray, "all 3"]
    index: Int64[np.ndarray, "points"]
    canonical_frame: int
    config: FinalFitConfig
    kinds: tuple[JointKind, ...] = (REVOLUTE, PRISMATIC)

    @property
    def reach(self) -> float:
        """Robust reach of matches, in spacings."""
        return self.config.reach

    @property
    def plain_kinds(self) -> tuple[JointKind, ...]:
        """The kinds with the fewest degrees of freedom: what a joint is where nothing speaks for more."""
        least = min(kind.size for kind in self.kinds)
        return tuple(kind for kind in self.kinds if kind.size == least)

    def kinds_like(self, kind: JointKind) -> tuple[JointKind, ...]:
        """The kinds that a joint may get when it is fitted anew: the plain ones, or its own where it has more."""
        return self.plain_kinds if kind in self.plain_kinds else (kind,)

    @property
    def p(self) -> Float64[np.ndarray, "points 3"]:
        return self.registration.p

    @property
    def spacing(self) -> float:
        return self.registration.spacing

    def price(self, price: float) -> float:
        """A price of a part or link, which is meant for many frames, as it is for these."""
        return price_over(self.registration.evidence, price)

    def refine(self, fit: Fit, iterations: int) -> Fit:
        """Joints and states fitted to all frames, labels as they are."""
        linearise = lambda Ts: self.registration.linearise(fit.labels, Ts, self.reach)  # noqa: E731
        return Fit(fit_chain(fit.chain, linearise, self.canonical_frame, self.spacing, iterations), fit.labels)

    def point_costs(
        self, labels: Int64[np.ndarray, "points"], Ts: Float64[np.ndarray, "frames parts 4 4"]
    ) -> Float64[np.ndarray, "points"]:
        """Every point's cost with its part's motion (Registration.cost)."""
        return self.registration.cost(np.arange(len(labels)), labels, Ts)

    def cost(self, fit: Fit) -> float:
        """All points' costs under the fit's motions."""
        return float(self.point_costs(fit.labels, fit.chain.Ts).sum())

    def unexplained(self, fit: Fit) -> float:
        """The other way round: the costs of all frames' points at the posed model (Registration.cost_back)."""
        return self.registration.cost_back(fit.labels, fit.chain.Ts)


def working_frames(
    sequence: PointSequence,
    canonical_frame: int,
    config: FinalFitConfig,
    kinds: tuple[JointKind, ...] = (REVOLUTE, PRISMATIC),
    models: Sequence[KinematicModel] = (),
) -> Frames:
    """At most `config.points` well spread points of each frame.

    Models tell whether the frames were seen from outside only (views_from_outside).
    """
    frames = sequence.frames()
    chosen = [working_points(frame, config.points) for frame in frames]
    clouds = [frame[index] for frame, index in zip(frames, chosen, strict=True)]
    registration = Registration(clouds, canonical_frame, viewpoints=sequence.viewpoints)
    if models and sequence.viewpoints is None:
        seen = [
            seen_from(canonical_frame, registration.p, frames[one.canonical_frame], one.labels, one.Ts_frame_canonical)
            for one in models
        ]
        registration.views = views_from_outside(registration, seen)
    return Frames(registration, frames[canonical_frame], chosen[canonical_frame], canonical_frame, config, kinds)


def to_chain(model: KinematicModel, frames: Frames, still_root: float) -> Chain:
    """The model's tree with every joint made of the plain kind that explains the child's motion best.

    Kinds are judged by how far they leave the child's points from where they were seen: the choice knows no unit
    (where A.4 compares an angle with a length). A root that moves less than `still_root` spacings is held still.
    """
    order = parents_first(model.joint_parent, model.joint_child)
    parent, child = model.joint_parent[order], model.joint_child[order]
    samples = part_samples(frames.p_all, model.labels, frames.config.joint_samples)
    motions = relative_motions(model.Ts_frame_canonical, parent, child)
    fits = fit_joint(frames.plain_kinds, motions, samples[child]).since(model.canonical_frame)
    joints = [Joint.of(fits, int(parent[j]), int(child[j]), (j,)) for j in range(len(order))]
    T_frame_root = model.Ts_frame_canonical[:, model.root]
    free_root = _travel(T_frame_root, frames.p_all[model.labels == model.root]) > still_root * frames.spacing
    return Chain.of(joints, model.root, T_frame_root, free_root)


def relative_motions(
    Ts: Float64[np.ndarray, "frames parts 4 4"],
    parent: Int64[np.ndarray, "joints"],
    child: Int64[np.ndarray, "joints"],
) -> Float64[np.ndarray, "joints frames 4 4"]:
    """T_parent_child in canonical coordinates."""
    T = Ts.swapaxes(0, 1)
    return inverse(T[parent]) @ T[child]


def best_joint(
    kinds: Sequence[JointKind],
    parent: int,
    child: int,
    labels: Int64[np.ndarray, "points"],
    frames: Frames,
    Ts: Float64[np.ndarray, "frames parts 4 4"],
) -> Joint:
    """The joint of one of some kinds that best explains a part's motion against another one's, in closed form."""
    p_child = frames.p[labels == child]
    p_child = p_child[farthest_points(p_child, frames.config.joint_samples)]
    fit = fit_joint(kinds, inverse(Ts[:, parent]) @ Ts[:, child], p_child)
    return Joint.of(fit.since(frames.canonical_frame), parent, child)


def contact_place(
    p_parent: Float64[np.ndarray, "points 3"], p_child: Float64[np.ndarray, "others 3"]
) -> Float64[np.ndarray, "3"]:
    """The middle between the two nearest points of two parts."""
    distance, index = nearest(KDTree(p_parent), p_child)
    closest = distance.argmin()
    return 0.5 * (p_parent[index[closest]] + p_child[closest])


def contact_points(model: KinematicModel, p: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "joints 3"]:
    """The point of each joint's axis next to where its parts touch; the centre of a joint without an axis."""
    points = model.point.copy()
    for joint, kind in enumerate(model.kinds):
        if kind.has_axis:
            parent, child = (p[model.labels == end[joint]] for end in (model.joint_parent, model.joint_child))
            points[joint] = next_to_contact(parent, child, model.axis[joint], model.point[joint])
    return points


def to_model(model: KinematicModel, fit: Fit, frames: Frames) -> KinematicModel:
    """The fitted tree as a model, every canonical point labelled as the working point nearest to it."""
    chain, tree = fit.chain, fit.chain.tree
    labels = fit.labels[nearest(KDTree(frames.p), frames.p_all)[1]]
    labels[frames.index] = fit.labels
    joints = len(tree.child)
    has_axis = np.array([kind.has_axis for kind in tree.kinds], dtype=bool)[:, None]
    return model.replace(
        root=tree.root,
        labels=labels,
        Ts_frame_canonical=chain.Ts,
        joint_parent=tree.parent,
        joint_child=tree.child,
        joint_types=tuple(kind.name for kind in tree.kinds),
        axis=tree.axis,
        point=np.where(has_axis, nearest_point_to_origin(tree.axis, tree.point), tree.point),
        states=chain.joint_states,
        e_spatial=np.zeros(joints),
        e_1dof=np.zeros(joints),
    )


def chain_of(model: KinematicModel, free_root: bool) -> Chain:
    """The chain of a kinematic model. Its root stays where it is in the canonical frame unless it is free."""
    joints = [
        Joint(kind, int(parent), int(child), axis, point, model.states_of(index))
        for index, (kind, parent, child, axis, point) in enumerate(
            zip(model.kinds, model.joint_parent, model.joint_child, model.axis, model.point, strict=True)
        )
    ]
    return Chain.of(joints, model.root, model.Ts_frame_canonical[:, model.root], free_root)


def root_moves(T_frame_root: Float64[np.ndarray, "frames 4 4"]) -> bool:
    """Whether a root, in the normalised frame, is elsewhere in some frame than in the canonical one."""
    return not np.allclose(T_frame_root, np.eye(4), atol=1e-6)


def _travel(Ts: Float64[np.ndarray, "frames 4 4"], p: Float64[np.ndarray, "points 3"]) -> float:
    """RMS distance, over frames and points, that points move from where they are in the canonical frame."""
    moved = move_points(Ts[:, None], p)
    return float(np.sqrt(((moved - p) ** 2).sum(axis=-1).mean())) if len(p) else 0.0
