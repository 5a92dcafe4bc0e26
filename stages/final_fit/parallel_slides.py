"""Slides on slides: along one axis a part slides on either of two others, so E_1DOF cannot tell which it hangs on.

A drawer slides on the drawer below as it does on their cabinet, and E_spatial is the same where all three touch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Int64

from schemas.joints import PRISMATIC
from stages.final_fit.working import Fit, Frames, best_joint
from stages.kernels.kinematics.chain import Chain, Joint
from stages.kernels.points.nearest import KDTree, nearest

PARALLEL = np.cos(np.radians(10.0))  # axes at a smaller angle may be the same


def hang_slides(fit: Fit, frames: Frames, part_price: float, iterations: int) -> Fit:
    """Slides on slides along the same axis hung on their grandparent, where they touch it more than their parent, or
    touch it and move less against it. A telescope's inner tube does neither.

    Joints are refined; where all points' costs then rise by `part_price`, the axes were not the same.
    """
    cost = frames.cost(fit)
    for part in fit.chain.tree.child.tolist():
        own, below = _slides(fit.chain, part)
        if below is None:
            continue
        touches, touches_below = (_touching_points(fit.labels, frames, part, joint.parent) for joint in (own, below))
        if touches_below == 0:
            continue
        hung = best_joint(frames.kinds_like(own.kind), below.parent, part, fit.labels, frames, fit.chain.Ts)
        if touches_below <= touches and hung.states.std() >= own.states.std():
            continue
        chain = fit.chain.with_joints([hung if joint.child == part else joint for joint in fit.chain.joints()])
        trial = frames.refine(replace(fit, chain=chain), iterations)
        if (there := frames.cost(trial)) < cost + part_price:
            cost, fit = there, trial
    return fit


def _slides(chain: Chain, part: int) -> tuple[Joint, Joint | None]:
    """A part's joint and its parent's, this one None where not both slide along the same axis."""
    joints = {joint.child: joint for joint in chain.joints()}
    own, below = joints[part], joints.get(joints[part].parent)
    if below is None or own.kind != PRISMATIC or below.kind != PRISMATIC:
        return own, None
    return own, below if abs(float(own.axis @ below.axis)) >= PARALLEL else None


def _touching_points(labels: Int64[np.ndarray, "points"], frames: Frames, part: int, other: int) -> int:
    """How many points of a part touch another one."""
    p_part, p_other = (frames.p[labels == number] for number in (part, other))
    if len(p_part) == 0 or len(p_other) == 0:
        return 0
    return int((nearest(KDTree(p_other), p_part)[0] < frames.config.contact * frames.spacing).sum())
