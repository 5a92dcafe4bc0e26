"""Parts that the frames do not need: what can join its neighbour at little cost, joints refitted, does so (A.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Int64

from stages.final_fit.working import JOINT_SAMPLES, Fit, Frames, joint_fits
from stages.kernels.articulation import Chain, Joint
from stages.kernels.sampling import farthest_points

# a rise of so many prices is given up: before joints are refined, and after so few steps of it
ABSURD, FIRST_LOOK, HOPELESS = 40.0, 2, 8.0


def prune(fit: Fit, frames: Frames, part_price: float, iterations: int) -> Fit:
    """Parts joined to their parent or only child, smallest first, wherever all points' costs rise by less than
    `part_price`."""
    counts = np.bincount(fit.labels, minlength=fit.chain.parts)
    names = list(range(fit.chain.parts))  # parts by their first numbers, as joining renumbers them
    cost = cost_of(fit, frames)
    for name in np.argsort(counts, kind="stable").tolist():
        part = names.index(name)
        for into in _neighbours(fit.chain, part):
            joined = join(fit, frames, part, into)
            if cost_of(joined, frames) >= cost + ABSURD * part_price:
                continue
            joined = frames.refine(joined, FIRST_LOOK)
            if cost_of(joined, frames) >= cost + HOPELESS * part_price:
                continue
            joined = frames.refine(joined, iterations)
            if (there := cost_of(joined, frames)) < cost + part_price:
                cost, fit = there, joined
                names.remove(name)
                break
    return fit


def join(fit: Fit, frames: Frames, part: int, into: int) -> Fit:
    """The fit with `part` made one with its neighbour `into`; what hung on it hangs on that, by refitted joints."""
    chain, Ts = fit.chain, fit.chain.Ts()
    labels = np.where(fit.labels == part, into, fit.labels)
    number = np.cumsum(np.arange(chain.parts) != part) - 1  # parts behind the one that goes move up
    root = into if chain.root == part else chain.root
    joints: list[Joint] = []
    for joint in map(chain.joint, range(len(chain.child))):
        if {joint.parent, joint.child} == {part, into}:
            continue
        if part not in (joint.parent, joint.child):
            joints.append(_numbered(joint, number))
            continue
        parent, child = (into if end == part else end for end in (joint.parent, joint.child))
        joints.append(_numbered(_refitted(parent, child, labels, frames, Ts), number))
    T_frame_root = Ts[:, root] if chain.free_root else chain.T_frame_root
    whole = replace(chain, root=int(number[root]), T_frame_root=T_frame_root)
    return Fit(whole.with_joints(joints), number[labels])


def _refitted(parent: int, child: int, labels: Int64[np.ndarray, "points"], frames: Frames, Ts: np.ndarray) -> Joint:
    p_child = frames.p[labels == child]
    p_child = p_child[farthest_points(p_child, JOINT_SAMPLES)]
    fits = joint_fits(Ts, np.array([parent]), np.array([child]), p_child[None])
    states = fits.states[0] - fits.states[0, frames.canonical_frame]
    return Joint(parent, child, bool(fits.revolute[0]), fits.axis[0], fits.point[0], states)


def _numbered(joint: Joint, number: Int64[np.ndarray, "parts"]) -> Joint:
    return replace(joint, parent=int(number[joint.parent]), child=int(number[joint.child]))


def _neighbours(chain: Chain, part: int) -> list[int]:
    """What a part may be made one with: its parent, and its child where there is only one."""
    parents = chain.parents()
    children = np.flatnonzero(parents == part).tolist()
    return ([int(parents[part])] if parents[part] >= 0 else []) + (children if len(children) == 1 else [])


def cost_of(fit: Fit, frames: Frames) -> float:
    """All points' costs under the fit's motions."""
    return float(frames.point_costs(fit.labels, fit.chain.Ts()).sum())
