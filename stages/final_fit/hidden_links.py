"""Links that the motion needs, though the relaxed fit did not see them.

A short link that is round about its joint's axis, such as a motor's housing, looks alike however it turns: its points
fit its neighbour's motion as well. Without it two parts that it links have two degrees of freedom between them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int64

from schemas.joints import REVOLUTE, JointKind
from stages.final_fit.motion_model import MotionModel
from stages.final_fit.screw_pair import ScrewPair, fit_screw_pair
from stages.final_fit.working import JOINT_SAMPLES, Fit, Frames, contact_of
from stages.kernels.kinematics.chain import Chain, Joint, fit_chain
from stages.kernels.kinematics.closed_form import fit_joint
from stages.kernels.motion.rigid_motion import inverse
from stages.kernels.points.sampling import farthest_points

TOLERATED = 0.25  # RMS, in spacings, that one joint may leave of a relative motion before two are tried
EXPLAINED = 0.6  # two joints leave at most this share of it
ROUNDS = 6  # in which links are inserted: a joint of three degrees of freedom needs two
PAIR_STEPS = 6  # Levenberg-Marquardt steps on each start of such a pair
TRIAL, SETTLE = 10, 40  # Levenberg-Marquardt steps on the motion model, to judge a chain and to fit it
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

    A joint gets a further link within it, or becomes one of a kind with more degrees of freedom, where that lowers the
    points' costs by more than `link_price`, or than `freedom_price` for each further degree; the greatest gain comes
    first. Without a link price no links are inserted. Where the root itself moves about one fixed axis, it is hung on
    a still base. New links have no points yet.
    """
    trials = _Trials(fit.labels, frames, Ts_free, link_price, freedom_price)
    chain = trials.fit(fit.chain, SETTLE)
    cost = trials.cost(chain)
    for _ in range(ROUNDS):
        freer = {link: trials.freed(chain, link, cost) for link in _links(chain)}
        gains = {link: trial.gain for link, trial in freer.items() if trial is not None}
        before = chain
        for link in sorted(gains, key=lambda link: -gains[link]):
            trial = freer[link] if chain is before else trials.freed(chain, link, cost)
            if trial is not None:
                chain, cost = trial.chain, trials.cost(trial.chain)
        if chain is before:
            break
    return Fit(_on_still_base(trials.fit(chain, SETTLE), fit.labels, frames), fit.labels)


@dataclass(frozen=True)
class _Trial:
    """A chain with more freedom in one joint, and the fall of the points' costs beyond its price."""

    chain: Chain
    gain: float


@dataclass(frozen=True)
class _Trials:
    """Chains judged by what the frames say of the free motions, and the pairs of joints that may stand for one."""

    labels: Int64[np.ndarray, "points"]
    frames: Frames
    Ts_free: Float64[np.ndarray, "frames parts 4 4"]
    link_price: float | None
    freedom_price: float
    pairs: dict[Link, ScrewPair | None] = field(default_factory=dict)  # between parts that both have points

    @cached_property
    def model(self) -> MotionModel:
        equations = self.frames.registration.linearise(self.labels, self.Ts_free, self.frames.reach)
        return MotionModel(equations, self.Ts_free, self.frames.noise)

    def cost(self, chain: Chain) -> float:
        return self.model(chain.Ts).cost

    def fit(self, chain: Chain, iterations: int) -> Chain:
        return fit_chain(chain, self.model, self.frames.canonical_frame, self.frames.noise, iterations)

    def freed(self, chain: Chain, link: Link, cost: float) -> _Trial | None:
        """The best chain with more freedom in one of its joints; None where that is not worth its price."""
        joint = _links(chain).get(link)
        if joint is None:
            return None
        trials = [
            self._tried(self.with_kind(chain, joint, kind), price, cost) for kind, price in self.freer(chain, joint)
        ]
        if self.link_price is not None and chain.tree.kinds[joint] in self.frames.plain_kinds:
            pair = self.pair(chain, *link)
            trials += [] if pair is None else [self._tried(_with_link(chain, joint, pair), self.link_price, cost)]
        worth = [trial for trial in trials if trial.gain > 0]
        return max(worth, key=lambda trial: trial.gain, default=None)

    def _tried(self, chain: Chain, price: float, cost: float) -> _Trial:
        fitted = self.fit(chain, TRIAL)
        return _Trial(fitted, cost - price - self.cost(fitted))

    def freer(self, chain: Chain, joint: int) -> list[tuple[JointKind, float]]:
        """The kinds with more degrees of freedom than a joint has, and their prices; none where a part is unseen."""
        tree = chain.tree
        if not all((self.labels == part).any() for part in (tree.parent[joint], tree.child[joint])):
            return []
        size = tree.kinds[joint].size
        return [(kind, self.freedom_price * (kind.size - size)) for kind in self.frames.kinds if kind.size > size]

    def with_kind(self, chain: Chain, joint: int, kind: JointKind) -> Chain:
        """The chain with one of its joints made the best one of another kind."""
        joints = chain.joints()
        parent, child = joints[joint].parent, joints[joint].child
        p_child = self.frames.p[self.labels == child]
        motion = inverse(self.Ts_free[:, parent]) @ self.Ts_free[:, child]
        fit = fit_joint([kind], motion, p_child[farthest_points(p_child, JOINT_SAMPLES)])
        joints[joint] = Joint.of(fit.since(self.frames.canonical_frame), parent, child)
        return chain.with_joints(joints)

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
        contact = contact_of(frames.p[self.labels == seen], p_child)
        p_child = p_child[farthest_points(p_child, JOINT_SAMPLES)]
        motion = np.linalg.inv(T_frame_parent) @ self.Ts_free[:, child]
        left = float(fit_joint(frames.plain_kinds, motion, p_child).rms)
        if left <= TOLERATED * frames.noise:
            return None
        pair = fit_screw_pair(motion, p_child, contact, frames.canonical_frame, frames.noise, PAIR_STEPS)
        return pair if pair.residual < EXPLAINED * left else None


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
    p_root = p_root[farthest_points(p_root, JOINT_SAMPLES)]
    turn = fit_joint([REVOLUTE], chain.T_frame_root, p_root).since(frames.canonical_frame)
    if turn.rms > STILL_BASE * frames.noise:
        return chain
    return Chain.of([Joint.of(turn, base, root), *chain.joints()], base, chain.T_frame_root, free_root=False)
