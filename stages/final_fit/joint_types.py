"""Joint types by evidence: what looked like sliding is tried as turning, joints refitted (A.4 decides by motions only).

A thin part may spin about its length unseen; the rotations that a free fit gives it are then noise, and a hinge looks
like a slide. Its centre tells better: it turns about the contact with the parent.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from schemas.joints import PRISMATIC, REVOLUTE
from stages.final_fit.motion_model import TRIAL_STEPS, MotionModel
from stages.final_fit.working import Fit, Frames, best_joint, contact_place
from stages.kernels.kinematics.chain import Joint, fit_chain


def try_hinges(fit: Fit, frames: Frames, iterations: int) -> Fit:
    """Each prismatic joint made a hinge at its contact where that leaves less of the frames, both refined as long."""
    for index in [index for index, kind in enumerate(fit.chain.tree.kinds) if kind == PRISMATIC]:
        joint = fit.chain.joint(index)
        p_parent, p_child = (frames.p[fit.labels == part] for part in (joint.parent, joint.child))
        if len(p_parent) == 0 or len(p_child) == 0:
            continue
        hinge = hinge_at(contact_place(p_parent, p_child), p_child.mean(axis=0), joint)
        joints = fit.chain.joints()
        joints[index] = hinge
        trial = frames.refine(Fit(fit.chain.with_joints(joints), fit.labels), iterations)
        fit = frames.refine(fit, iterations)
        if frames.cost(trial) < frames.cost(fit):
            fit = trial
    return fit


def simplify_joints(fit: Fit, frames: Frames, freedom_price: float) -> Fit:
    """Joints of more than the least freedom made plain where that costs less than the freedom that they give up.

    Judged by the quadratic model of the frames about the fit's own motions; nothing is matched anew.
    """
    chain, spacing = fit.chain, frames.spacing
    freer = [index for index, kind in enumerate(chain.tree.kinds) if kind not in frames.plain_kinds]
    if not freer:
        return fit
    equations = frames.registration.linearise(fit.labels, chain.Ts, frames.reach)
    model = MotionModel(equations, chain.Ts, spacing)
    for index in freer:
        joint = chain.joint(index)
        if not (fit.labels == joint.child).any():
            continue
        joints = chain.joints()
        joints[index] = best_joint(frames.plain_kinds, joint.parent, joint.child, fit.labels, frames, chain.Ts)
        trial = fit_chain(chain.with_joints(joints), model, frames.canonical_frame, spacing, TRIAL_STEPS)
        given_up = freedom_price * (joint.kind.size - joints[index].kind.size)
        if model(trial.Ts).cost < model(chain.Ts).cost + given_up:
            chain = trial
    return Fit(chain, fit.labels)


def hinge_at(p_contact: Float64[np.ndarray, "3"], p_centre: Float64[np.ndarray, "3"], slide: Joint) -> Joint:
    """The hinge through a point whose child's centre turns nearest to where a prismatic joint takes it."""
    arm = p_centre - p_contact
    moved = arm + slide.states * slide.axis
    axis = np.cross(arm, slide.axis)
    axis /= max(float(np.linalg.norm(axis)), 1e-12)
    across = np.cross(axis, arm)
    angles = np.arctan2(moved @ across, moved @ arm)
    return replace(slide, kind=REVOLUTE, axis=axis, point=p_contact, states=angles[:, None])
