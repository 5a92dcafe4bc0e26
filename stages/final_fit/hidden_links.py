"""Links that the motion needs, though the relaxed fit did not see them.

A short link that is round about its joint's axis, such as a motor's housing, looks alike however it turns: its points
fit its neighbour's motion as well. Without it two parts that it links have two degrees of freedom between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float64, Int64

from stages.final_fit.working import JOINT_SAMPLES, Fit, Frames, contact_of, relative_motions
from stages.kernels.articulation import Chain, Joint
from stages.kernels.sampling import farthest_points
from stages.kernels.screw import ScrewFit, fit_screw
from stages.kernels.screw_pair import ScrewPair, fit_screw_pair

TOLERATED = 0.5  # RMS, in spacings, that one joint may leave of a relative motion before two are tried
EXPLAINED, CLOSE = 0.35, 0.5  # two joints leave at most this share of it, and at most so many spacings
EXCESS = 12.0  # what one joint must cost a part's points in all, over its free motion
STILL_BASE = 0.3  # RMS, in spacings, that one joint may leave of the root's motion


def insert_hidden_links(
    fit: Fit, frames: Frames, Ts_free: Float64[np.ndarray, "frames parts 4 4"], iterations: int
) -> Fit:
    """A link of its own in every joint where one degree of freedom does not explain the free motions, and two do.

    Where the root itself moves about one fixed axis, it is hung on a still base. New links have no points yet.
    """
    single = frames.refine(fit, iterations)
    pairs = _explained_by_two(fit, frames, single.chain.Ts(), Ts_free)
    chain = _with_links(fit.chain, pairs) if pairs else single.chain
    return Fit(_on_still_base(chain, fit.labels, frames), fit.labels)


def _explained_by_two(
    fit: Fit,
    frames: Frames,
    Ts: Float64[np.ndarray, "frames parts 4 4"],
    Ts_free: Float64[np.ndarray, "frames parts 4 4"],
) -> dict[int, ScrewPair]:
    """Joints whose child's points cost clearly more by `Ts` than by their free motion, with the two joints in a row
    that explain that motion where one does not."""
    excess = frames.point_costs(fit.labels, Ts) - frames.point_costs(fit.labels, Ts_free)
    excess_of = np.bincount(fit.labels, excess, minlength=fit.chain.parts)
    motions = relative_motions(Ts_free, fit.chain.parent, fit.chain.child)
    pairs = {}
    for joint, (parent, child) in enumerate(zip(fit.chain.parent, fit.chain.child, strict=True)):
        if excess_of[child] <= EXCESS or not (fit.labels == parent).any():
            continue
        p_child = frames.p[fit.labels == child]
        contact = contact_of(frames.p[fit.labels == parent], p_child)
        p_child = p_child[farthest_points(p_child, JOINT_SAMPLES)]
        p, motion = torch.from_numpy(p_child), motions[joint]
        left = min(_rms(fit_screw(motion, p, "revolute")), _rms(fit_screw(motion, p, "prismatic")))
        if left <= TOLERATED * frames.noise:
            continue
        pair = fit_screw_pair(motion.numpy(), p_child, contact, frames.canonical_frame, frames.noise)
        if pair.residual < min(EXPLAINED * left, CLOSE * frames.noise):
            pairs[joint] = pair
    return pairs


def _rms(fit: ScrewFit) -> float:
    return float(fit.residual.sqrt())


def _with_links(chain: Chain, pairs: Mapping[int, ScrewPair]) -> Chain:
    """The chain with a further part inside each of some joints; new parts are numbered behind the others."""
    joints: list[Joint] = []
    links = chain.parts
    for joint in range(len(chain.child)):
        whole = chain.joint(joint)
        if joint not in pairs:
            joints.append(whole)
            continue
        pair = pairs[joint]
        first, second = (Joint(0, 0, True, pair.axis[k], pair.point[k], pair.states[k]) for k in (0, 1))
        joints += [replace(first, parent=whole.parent, child=links), replace(second, parent=links, child=whole.child)]
        links += 1
    return chain.with_joints(joints)


def _on_still_base(chain: Chain, labels: Int64[np.ndarray, "points"], frames: Frames) -> Chain:
    """A moving root that one revolute joint explains becomes the child of a still part."""
    if not chain.free_root:
        return chain
    p_root = frames.p[labels == chain.root]
    p = torch.from_numpy(p_root[farthest_points(p_root, JOINT_SAMPLES)])
    turn = fit_screw(torch.from_numpy(chain.T_frame_root), p, "revolute")
    if _rms(turn) > STILL_BASE * frames.noise:
        return chain
    states = turn.states.numpy()[:, 0]
    base = chain.parts
    joint = Joint(
        base, chain.root, True, turn.axis.numpy(), turn.point.numpy(), states - states[frames.canonical_frame]
    )
    joints = [joint, *(chain.joint(j) for j in range(len(chain.child)))]
    still = np.tile(np.eye(4), (len(chain.T_frame_root), 1, 1))
    return replace(chain.with_joints(joints), root=base, T_frame_root=still, free_root=False)
