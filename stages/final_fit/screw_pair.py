"""Two revolute joints in a row: the relative motion of two parts through a link between them that was not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from schemas.joints import REVOLUTE
from stages.kernels.alignment.registration import NormalEquations, twist_jacobian
from stages.kernels.kinematics.chain import Chain, Joint, fit_chain
from stages.kernels.motion.rigid_motion import move_points, rotation_vectors

AS_GOOD = 1.3, 0.05  # a fit is as good as the best within this factor, or so many spacings


@dataclass(frozen=True)
class ScrewPair:
    """Axes, points and angles (radians) of the joint on the parent and the joint on the child; RMS left over."""

    axis: Float64[np.ndarray, "2 3"]
    point: Float64[np.ndarray, "2 3"]
    states: Float64[np.ndarray, "frames 2"]
    rms: float


def fit_screw_pair(
    Ts_parent_child: Float64[np.ndarray, "frames 4 4"],
    p_child: Float64[np.ndarray, "points 3"],
    p_contact: Float64[np.ndarray, "3"],
    canonical_frame: int,
    spacing: float,
    iterations: int,
    directions: int,
) -> ScrewPair:
    """The two revolute joints in a row that best take the child's points where the motion takes them.

    Starts with perpendicular axes through `p_contact`, in so many `directions` of the plane in which the rotation
    vectors lie. Of fits about as good as the best, the one that turns least is taken: axes nearly parallel can explain
    anything by large angles.
    """
    frames = len(Ts_parent_child)
    target = move_points(Ts_parent_child[:, None], p_child)
    rotations = rotation_vectors(Ts_parent_child[:, :3, :3])
    plane = np.linalg.svd(rotations, full_matrices=True)[2]

    def linearise(Ts: Float64[np.ndarray, "frames 3 4 4"]) -> NormalEquations:
        p = move_points(Ts[:, 2, None], p_child)
        hessian, gradient = np.zeros((frames, 3, 6, 6)), np.zeros((frames, 3, 6))
        centres = np.zeros((frames, 3, 3))
        centres[:, 2] = p.mean(axis=1)
        jacobian = twist_jacobian((p - centres[:, 2, None]) / spacing)
        offset = (p - target) / spacing
        hessian[:, 2] = np.einsum("tnia,tnib->tab", jacobian, jacobian)
        gradient[:, 2] = np.einsum("tnia,tni->ta", jacobian, offset)
        return NormalEquations(float((offset**2).sum()), hessian, gradient, centres)

    fits = []
    for angle in np.arange(directions) * np.pi / directions:
        first = np.cos(angle) * plane[0] + np.sin(angle) * plane[1]
        second = np.cos(angle) * plane[1] - np.sin(angle) * plane[0]
        axis = np.stack([first, second])
        states = rotations @ axis.T
        states -= states[canonical_frame]
        joints = [Joint(REVOLUTE, k, k + 1, axis[k], p_contact, states[:, [k]]) for k in (0, 1)]
        chain = Chain.of(joints, 0, Ts_parent_child, free_root=False)
        chain = fit_chain(chain, linearise, canonical_frame, spacing, iterations)
        rms = spacing * np.sqrt(linearise(chain.Ts).cost / (frames * len(p_child)))
        fits.append(ScrewPair(chain.tree.axis, chain.tree.point, chain.states, float(rms)))
    best = min(fit.rms for fit in fits)
    factor, slack = AS_GOOD
    good = [fit for fit in fits if fit.rms <= max(factor * best, best + slack * spacing)]
    return min(good, key=lambda fit: float(np.ptp(fit.states, axis=0).sum()))
