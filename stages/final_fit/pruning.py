"""Parts that the frames do not need: what can join its neighbour at little cost, joints refitted, does so (A.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Int64

from stages.final_fit.consensus import consensus_joint
from stages.final_fit.working import Fit, Frames, best_joint
from stages.kernels.kinematics.chain import Chain, Joint

# a rise of so many prices is given up: before joints are refined, and after so few steps of it
ABSURD, FIRST_LOOK, HOPELESS = 40.0, 2, 8.0


def prune(fit: Fit, frames: Frames, part_price: float, iterations: int) -> Fit:
    """Parts made one with a neighbour in the tree, smallest first, that the frames do not need.

    A part is needed only where without it all points' costs rise by `part_price`, and those of the frames at the model
    rise too: a few points of a thin place fit wherever points lie dense, but then nothing is where they were.
    """
    counts = np.bincount(fit.labels, minlength=fit.chain.parts)
    names = list(range(fit.chain.parts))  # parts by their first numbers, as joining renumbers them
    cost = frames.cost(fit)
    unexplained = frames.unexplained(frames.refine(fit, FIRST_LOOK + iterations))  # refined as long as what is tried
    for name in np.argsort(counts, kind="stable").tolist():
        part = names.index(name)
        neighbours = _neighbours(fit.chain, part)
        for into, rise in zip(neighbours, _rises(fit, frames, part, neighbours), strict=True):
            if rise >= ABSURD * part_price:
                continue
            joined = join(fit, frames, part, into)
            if frames.cost(joined) >= cost + ABSURD * part_price:
                continue
            joined = frames.refine(joined, FIRST_LOOK)
            if frames.cost(joined) >= cost + HOPELESS * part_price:
                continue
            joined = frames.refine(joined, iterations)
            cost_joined, unexplained_joined = frames.cost(joined), frames.unexplained(joined)
            less_unexplained = unexplained_joined < unexplained and cost_joined < cost + HOPELESS * part_price
            if cost_joined < cost + part_price or less_unexplained:
                cost, unexplained, fit = cost_joined, unexplained_joined, joined
                names.remove(name)
                break
    return fit


def join(fit: Fit, frames: Frames, part: int, into: int) -> Fit:
    """The fit with `part` made one with `into`, its child or what does not hang on it; what hung on it hangs on that,
    by refitted joints."""
    chain, Ts = fit.chain, fit.chain.Ts
    tree = chain.tree
    labels = np.where(fit.labels == part, into, fit.labels)
    number = np.cumsum(np.arange(chain.parts) != part) - 1  # parts behind the one that goes move up
    root = into if tree.root == part else tree.root
    gone = into if tree.parents[into] == part else part  # the child of the joint that goes
    joints: list[Joint] = []
    for joint in chain.joints():
        if joint.child == gone:
            continue
        if part not in (joint.parent, joint.child):
            joints.append(_numbered(joint, number))
            continue
        parent, child = (into if end == part else end for end in (joint.parent, joint.child))
        kinds = frames.kinds_like(joint.kind)
        refitted = consensus_joint(kinds, parent, child, labels, frames, Ts)
        joints.append(_numbered(refitted or best_joint(kinds, parent, child, labels, frames, Ts), number))
    return Fit(Chain.of(joints, int(number[root]), Ts[:, root], tree.free_root), number[labels])


def _numbered(joint: Joint, number: Int64[np.ndarray, "parts"]) -> Joint:
    return replace(joint, parent=int(number[joint.parent]), child=int(number[joint.child]))


def _neighbours(chain: Chain, part: int) -> list[int]:
    """What a part may be made one with: its parent, its child where there is only one, and what is linked to its
    parent, as pieces of one rigid part may be seen apart: a frame on both sides of its door."""
    parents = chain.tree.parents
    children, parent = np.flatnonzero(parents == part).tolist(), int(parents[part])
    only = children if len(children) == 1 else []
    if parent < 0:
        return only
    beyond = [int(parents[parent])] if parents[parent] >= 0 else []
    siblings = np.setdiff1d(np.flatnonzero(parents == parent), [part]).tolist()
    return [parent, *only, *beyond, *siblings]


def _rises(fit: Fit, frames: Frames, part: int, others: list[int]) -> list[float]:
    """What the points of a part would cost more with the motion of each of some others as it is."""
    index, Ts = np.flatnonzero(fit.labels == part), fit.chain.Ts
    own, *rest = (frames.registration.cost(index, np.full(len(index), number), Ts) for number in (part, *others))
    return [float((cost - own).sum()) for cost in rest]
