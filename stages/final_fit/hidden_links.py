"""Links that the motion needs, though the relaxed fit did not see them.

A short link that is round about its joint's axis, such as a motor's housing, looks alike however it turns: its points
fit its neighbour's motion as well. Without it two parts that it links have two degrees of freedom between them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from jaxtyping import Float64, Int64

from schemas.joints import REVOLUTE
from stages.final_fit.motion_model import TRIAL_STEPS, MotionModel
from stages.final_fit.screw_pair import ScrewPair, fit_screw_pair
from stages.final_fit.working import Fit, Frames, best_joint, contact_place
from stages.kernels.kinematics.chain import Chain, Joint, fit_chain
from stages.kernels.kinematics.closed_form import fit_joint
from stages.kernels.points.sampling import farthest_points

ROUNDS = 6  # in which links are inserted: a joint of three degrees of freedom needs two
PAIR_STEPS = 6  # Levenberg-Marquardt steps on each start of such a pair
SETTLE = 40  # Levenberg-Marquardt steps on the motion model, to fit a chain
STILL_BASE = 0.3  # RMS, in spacings, that one joint may leave of the root's motion
Link = tuple[int, int]  # a joint's parent and child


def add_freedom(
    fit: Fit,
    frames: Frames,
    Ts_free: Float64[np.ndarray, "frames parts 4 4"],
    link_price: float | None,
    freedom_price: float,
) -> Fit:
    """The tree fitted to the free motions, with more freedom in its joints where the frames ask for it.

    A joint gets a further link within it where that lowers the points' costs by more than `link_price`, or becomes one
    of a kind with more degrees of freedom where that lowers them by more than `freedom_price` for each. The greatest
    gain comes first. Kinds with more freedom than a further link gives, as ball joints have, come after all links: both
    explain most motions of few frames as well. Without a link price none are inserted. Where the root itself moves
    about one fixed axis, it is hung on a still base. New links have no points yet.
    """
    trials = _Trials(fit.labels, frames, Ts_free)
    chain = trials.fit(fit.chain, SETTLE)
    if link_price is not None:
        pairs = partial(trials.with_link, price=link_price)
        kinds = partial(trials.with_kinds, price=freedom_price, most=1)  # as much freedom as a link gives
        chain = trials.freed(chain, lambda chain, joint: pairs(chain, joint) + kinds(chain, joint))
    chain = trials.freed(chain, partial(trials.with_kinds, price=freedom_price))
    return Fit(_on_still_base(trials.fit(chain, SETTLE), fit.labels, frames), fit.labels)


@dataclass(frozen=True)
class _Trial:
    """A chain with more freedom in one joint, and the price of that."""

    chain: Chain
    price: float


Offers = Callable[[Chain, int], list[_Trial]]  # what may be made of one of a chain's joints


@dataclass(frozen=True)
class _Trials:
    """Chains judged by what the frames say of the free motions, and the pairs of joints that may stand for one."""

    labels: Int64[np.ndarray, "points"]
    frames: Frames
    Ts_free: Float64[np.ndarray, "frames parts 4 4"]
    pairs: dict[Link, ScrewPair | None] = field(default_factory=dict)  # between parts that both have points

    @cached_property
    def model(self) -> MotionModel:
        equations = self.frames.registration.linearise(self.labels, self.Ts_free, self.frames.reach)
        return MotionModel(equations, self.Ts_free, self.frames.spacing)

    def cost(self, chain: Chain) -> float:
        return self.model(chain.Ts).cost

    def fit(self, chain: Chain, iterations: int) -> Chain:
        return fit_chain(chain, self.model, self.frames.canonical_frame, self.frames.spacing, iterations)

    def freed(self, chain: Chain, offers: Offers) -> Chain:
        """The chain with what is offered for its joints wherever that is worth its price, the greatest gain first."""
        cost = self.cost(chain)
        for _ in range(ROUNDS):
            best = {link: self._best(chain, link, offers, cost) for link in _links(chain)}
            gains = {link: gain for link, (_, gain) in best.items() if gain > 0}
            before = chain
            for link in sorted(gains, key=lambda link: -gains[link]):
                trial, gain = best[link] if chain is before else self._best(chain, link, offers, cost)
                if gain > 0:
                    chain, cost = trial, self.cost(trial)
            if chain is before:
                break
        return chain

    def _best(self, chain: Chain, link: Link, offers: Offers, cost: float) -> tuple[Chain, float]:
        """The best of what is offered for one joint, fitted, and by how much more than its price it lowers the cost."""
        joint = _links(chain).get(link)
        offered = [] if joint is None else offers(chain, joint)
        fitted = [(self.fit(one.chain, TRIAL_STEPS), one.price) for one in offered]
        gains = [(trial, cost - self.cost(trial) - price) for trial, price in fitted]
        return max(gains, key=lambda found: found[1], default=(chain, 0.0))

    def with_link(self, chain: Chain, joint: int, price: float) -> list[_Trial]:
        """The chain with a further link within one of its joints, where that joint needs one."""
        pair = self.pair(chain, int(chain.tree.parent[joint]), int(chain.tree.child[joint]))
        return [] if pair is None else [_Trial(_with_link(chain, joint, pair), price)]

    def with_kinds(self, chain: Chain, joint: int, price: float, most: int = 6) -> list[_Trial]:
        """The chain with one of its joints made one of each kind with more freedom; none where a part is unseen.

        `most` is the number of further degrees that a kind may have.
        """
        own, trials = chain.joint(joint), []
        if not all((self.labels == part).any() for part in (own.parent, own.child)):
            return []
        for kind in self.frames.kinds:
            if own.kind.size < kind.size <= own.kind.size + most:
                joints = chain.joints()
                joints[joint] = best_joint([kind], own.parent, own.child, self.labels, self.frames, self.Ts_free)
                trials.append(_Trial(chain.with_joints(joints), price * (kind.size - own.kind.size)))
        return trials

    def pair(self, chain: Chain, parent: int, child: int) -> ScrewPair | None:
        """Two joints in a row that explain the child's motion against its parent, where one does not."""
        seen = _seen_above(chain, self.labels, parent)
        if seen is None or not (self.labels == child).any():
            return None
        if seen != parent:  # the parent's motion is the chain's, which changes
            return self._pair(chain.Ts[:, parent], seen, child)
        if (parent, child) not in self.pairs:
            self.pairs[parent, child] = self._pair(self.Ts_free[:, parent], seen, child)
        return self.pairs[parent, child]

    def _pair(self, T_frame_parent: Float64[np.ndarray, "frames 4 4"], seen: int, child: int) -> ScrewPair | None:
        frames = self.frames
        p_child = frames.p[self.labels == child]
        p_contact = contact_place(frames.p[self.labels == seen], p_child)
        p_child = p_child[farthest_points(p_child, frames.config.joint_samples)]
        motion = np.linalg.inv(T_frame_parent) @ self.Ts_free[:, child]
        left = float(fit_joint(frames.plain_kinds, motion, p_child).rms)
        if left <= frames.config.link_tolerance * frames.spacing:
            return None
        pair = fit_screw_pair(
            motion,
            p_child,
            p_contact,
            frames.canonical_frame,
            frames.spacing,
            PAIR_STEPS,
            frames.config.pair_directions,
        )
        return pair if pair.rms < frames.config.link_explains * left else None


def _links(chain: Chain) -> dict[Link, int]:
    """Each joint's number, by the parts that it links."""
    return {
        link: joint
        for joint, link in enumerate(zip(chain.tree.parent.tolist(), chain.tree.child.tolist(), strict=True))
    }


def _seen_above(chain: Chain, labels: Int64[np.ndarray, "points"], part: int) -> int | None:
    """The part itself or the nearest part above it that has points."""
    parents = chain.tree.parents
    while part >= 0 and not (labels == part).any():
        part = int(parents[part])
    return part if part >= 0 else None


def _with_link(chain: Chain, joint: int, pair: ScrewPair) -> Chain:
    """The chain with a further part within one of its joints; the new part is numbered behind the others."""
    joints = chain.joints()
    first, second = (Joint(REVOLUTE, 0, 0, pair.axis[k], pair.point[k], pair.states[:, [k]]) for k in (0, 1))
    link, whole = chain.parts, joints[joint]
    joints[joint : joint + 1] = [
        replace(first, parent=whole.parent, child=link),
        replace(second, parent=link, child=whole.child),
    ]
    return chain.with_joints(joints)


def _on_still_base(chain: Chain, labels: Int64[np.ndarray, "points"], frames: Frames) -> Chain:
    """A moving root that one revolute joint explains becomes the child of a still part."""
    root, base = chain.tree.root, chain.parts
    p_root = frames.p[labels == root]
    if not chain.tree.free_root or len(p_root) == 0:
        return chain
    p_root = p_root[farthest_points(p_root, frames.config.joint_samples)]
    turn = fit_joint([REVOLUTE], chain.T_frame_root, p_root).since(frames.canonical_frame)
    if turn.rms > STILL_BASE * frames.spacing:
        return chain
    return Chain.of([Joint.of(turn, base, root), *chain.joints()], base, chain.T_frame_root, free_root=False)
