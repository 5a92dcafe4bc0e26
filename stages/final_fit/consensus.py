"""A joint that most frames agree on, where some frames' motions are wrong: what is lost in a frame goes far astray."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import Rotation

from schemas.joints import JointKind
from stages.final_fit.working import Frames
from stages.kernels.kinematics.chain import Joint
from stages.kernels.kinematics.closed_form import fit_joint
from stages.kernels.kinematics.tree import joint_transforms
from stages.kernels.motion.rigid_motion import inverse, move_points
from stages.kernels.points.sampling import farthest_points

ASTRAY = 3.0  # spacings, RMS, by which a joint misses a motion that it does not explain
MOST = 0.5  # share of the frames that must agree
STATES = 72  # tried in a frame that is astray: all angles, or three times the way that the others slide


def consensus_joint(
    kinds: Sequence[JointKind],
    parent: int,
    child: int,
    labels: Int64[np.ndarray, "points"],
    frames: Frames,
    Ts: Float64[np.ndarray, "frames parts 4 4"],
) -> Joint | None:
    """The joint of a child against its parent that explains most frames' motions, its states in the others sought anew.

    Joints are fitted to the motion of one frame each; the one that explains most frames is fitted to all of these. In
    each of the others the state wins in which the child's points cost least. None where a joint explains all frames or
    none explains most, or where kinds have more than one degree of freedom.
    """
    if any(kind.size != 1 for kind in kinds):
        return None
    p = frames.p[labels == child]
    p = p[farthest_points(p, frames.config.joint_samples)]
    motions = inverse(Ts[:, parent]) @ Ts[:, child]
    canonical, reach = frames.canonical_frame, ASTRAY * frames.spacing
    if fit_joint(kinds, motions, p).rms <= reach:
        return None
    agreeing = [
        _left(Joint.of(fit_joint(kinds, motions[[canonical, t]], p).since(0), parent, child), motions, p) <= reach
        for t in frames.registration.others
    ]
    agree = max(agreeing, key=np.count_nonzero)
    if np.count_nonzero(agree) < MOST * len(motions):
        return None
    index = np.flatnonzero(agree)
    fit = fit_joint(kinds, motions[index], p).since(int(np.searchsorted(index, canonical)))
    joint = Joint.of(fit, parent, child)
    states = np.zeros((len(motions), 1))
    states[index] = joint.states
    for t in np.flatnonzero(~agree):
        states[t] = _sought(joint, int(t), p, frames, Ts[t, parent])
    return Joint(joint.kind, parent, child, joint.axis, joint.point, states)


def _left(
    joint: Joint, motions: Float64[np.ndarray, "frames 4 4"], p: Float64[np.ndarray, "points 3"]
) -> Float64[np.ndarray, "frames"]:
    """What a joint leaves of each motion at best, RMS."""
    if joint.kind.turns == "axis":
        quaternions = Rotation.from_matrix(motions[:, :3, :3]).as_quat()
        states = 2 * np.arctan2(quaternions[:, :3] @ joint.axis, quaternions[:, 3])
    else:
        centre = p.mean(axis=0)
        states = (move_points(motions, centre) - centre) @ joint.axis
    moved = move_points(_motions(joint, states)[:, None], p)
    return np.sqrt(((moved - move_points(motions[:, None], p)) ** 2).sum(axis=-1).mean(axis=-1))


def _sought(
    joint: Joint, t: int, p: Float64[np.ndarray, "points 3"], frames: Frames, T_parent: Float64[np.ndarray, "4 4"]
) -> float:
    """The state in which the child's points cost least in a frame."""
    least, most = joint.states.min(), joint.states.max()
    reach = np.pi if joint.kind.turns == "axis" else 1.5 * (most - least)
    states = 0.5 * (least + most) + np.linspace(-reach, reach, STATES, endpoint=False)
    places = move_points((T_parent @ _motions(joint, states))[:, None], p)
    costs = frames.registration.place_costs(t, places.reshape(-1, 3)).reshape(len(states), -1)
    return float(states[costs.sum(axis=1).argmin()])


def _motions(joint: Joint, states: Float64[np.ndarray, "states"]) -> Float64[np.ndarray, "states 4 4"]:
    """The child's motion against its parent in some states."""
    return joint_transforms(joint.point, states[:, None] @ joint.kind.basis(joint.axis))
