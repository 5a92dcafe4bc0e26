"""A tree of one-degree-of-freedom joints, fitted to all frames at once by Levenberg-Marquardt."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64

from stages.kernels.alignment.registration import NormalEquations, turn_about, twist_jacobian
from stages.kernels.kinematics.forward_kinematics import forward_kinematics
from stages.kernels.kinematics.kinematic_tree import moved_parts
from stages.kernels.kinematics.screw import screw_transform

DAMPING_FIRST, DAMPING_LEAST, DAMPING_MOST = 1e-3, 1e-6, 1e4
SETTLED = 1e-5  # relative fall of the cost below which a fit has ended


@dataclass(frozen=True)
class Joint:
    """One joint of a chain: `states` (frames,) are radians (revolute) or lengths (prismatic)."""

    parent: int
    child: int
    revolute: bool
    axis: Float64[np.ndarray, "3"]
    point: Float64[np.ndarray, "3"]
    states: Float64[np.ndarray, "frames"]


@dataclass(frozen=True)
class Chain:
    """A kinematic tree in the canonical frame's coordinates.

    Joint j moves part `child[j]` against part `parent[j]`; a parent's own joint comes first. States are
    radians (revolute) or lengths (prismatic), zero in the canonical frame.
    """

    root: int
    parent: Int64[np.ndarray, "joints"]
    child: Int64[np.ndarray, "joints"]
    revolute: Bool[np.ndarray, "joints"]
    axis: Float64[np.ndarray, "joints 3"]
    point: Float64[np.ndarray, "joints 3"]
    states: Float64[np.ndarray, "joints frames"]
    T_frame_root: Float64[np.ndarray, "frames 4 4"]
    free_root: bool

    @property
    def parts(self) -> int:
        return len(self.child) + 1

    def joint_states(self) -> Float64[np.ndarray, "joints frames 2"]:
        """(angle, distance) of each joint."""
        turns = self.revolute[:, None]
        return np.stack([np.where(turns, self.states, 0.0), np.where(turns, 0.0, self.states)], axis=-1)

    def Ts(self) -> Float64[np.ndarray, "frames parts 4 4"]:
        """Where each part's canonical points lie in every frame."""
        return forward_kinematics(
            torch.from_numpy(self.T_frame_root),
            list(zip(self.parent.tolist(), self.child.tolist(), strict=True)),
            torch.from_numpy(self.axis),
            torch.from_numpy(self.point),
            torch.from_numpy(self.joint_states()),
            self.root,
        ).numpy()

    def parents(self) -> Int64[np.ndarray, "parts"]:
        """The parent of each part; -1 for the root."""
        parents = np.full(self.parts, -1)
        parents[self.child] = self.parent
        return parents

    def joint(self, index: int) -> Joint:
        """One of the joints."""
        return Joint(
            int(self.parent[index]),
            int(self.child[index]),
            bool(self.revolute[index]),
            self.axis[index],
            self.point[index],
            self.states[index],
        )

    def joints(self) -> list[Joint]:
        """All joints, in their order."""
        return [self.joint(index) for index in range(len(self.child))]

    def with_joints(self, joints: Sequence[Joint]) -> Chain:
        """The same root with other joints, parents' own first."""
        return replace(
            self,
            parent=np.array([joint.parent for joint in joints], dtype=np.int64),
            child=np.array([joint.child for joint in joints], dtype=np.int64),
            revolute=np.array([joint.revolute for joint in joints], dtype=bool),
            axis=np.array([joint.axis for joint in joints]).reshape(-1, 3),
            point=np.array([joint.point for joint in joints]).reshape(-1, 3),
            states=np.array([joint.states for joint in joints]).reshape(-1, self.states.shape[1]),
        )

    def moves(self) -> Bool[np.ndarray, "joints parts"]:
        """Which joint moves which part: its child and all that hangs on it."""
        return moved_parts(self.parent, self.child, self.parts, range(len(self.child)))


Linearise = Callable[[Float64[np.ndarray, "frames parts 4 4"]], NormalEquations]


def fit_chain(chain: Chain, linearise: Linearise, canonical_frame: int, noise: float, iterations: int) -> Chain:
    """Axes, states and the root's motion at which the data's cost is least, by damped Gauss-Newton steps.

    `linearise` tells cost and normal equations of parts' motions; it may match points anew at every call. The
    canonical frame keeps its zero states. Ends when the cost no longer falls, or after `iterations` trials.
    """
    others = np.arange(chain.states.shape[1]) != canonical_frame
    if len(chain.child) == 0 and not chain.free_root:
        return chain
    equations = linearise(chain.Ts())
    damping = DAMPING_FIRST
    for _ in range(iterations):
        trial = _step(chain, equations, others, noise, damping)
        there = linearise(trial.Ts())
        if there.cost < equations.cost:
            settled = equations.cost - there.cost < SETTLED * abs(equations.cost)
            chain, equations, damping = trial, there, max(damping / 5, DAMPING_LEAST)
            if settled:
                break
        elif damping >= DAMPING_MOST:
            break
        else:
            damping *= 8
    return chain


def _step(chain: Chain, equations: NormalEquations, others: np.ndarray, noise: float, damping: float) -> Chain:
    """One damped Gauss-Newton step.

    Unknowns are every frame's own states (and root twist) and, shared by all frames, a small rigid motion of
    each axis. The frames' own unknowns are eliminated first, so that time is linear in frames.
    """
    joints = len(chain.child)
    own, shared = _jacobians(chain, equations.centres, noise)
    frames, rows = int(others.sum()), 6 * chain.parts
    hessian, gradient = equations.hessian[others], equations.gradient[others].reshape(frames, rows)
    weighted = [
        np.matmul(hessian, jacobian[others]).reshape(frames, rows, jacobian.shape[-1]) for jacobian in (own, shared)
    ]
    own, shared = (jacobian[others].reshape(frames, rows, jacobian.shape[-1]) for jacobian in (own, shared))
    A, B = (own.transpose(0, 2, 1) @ columns for columns in weighted)
    C = (shared.transpose(0, 2, 1) @ weighted[1]).sum(axis=0)
    a = np.einsum("trn,tr->tn", own, gradient)
    c = np.einsum("trm,tr->m", shared, gradient)
    _damp(A, damping)
    _damp(C[None], damping)
    eliminated = np.linalg.solve(A, np.concatenate([B, a[..., None]], axis=2))
    reduced = C - np.einsum("tnm,tnk->mk", B, eliminated[..., :-1])
    right = c - np.einsum("tnm,tn->m", B, eliminated[..., -1])
    step_shared = -np.linalg.solve(reduced, right)
    step_own = np.zeros((len(others), own.shape[-1]))
    step_own[others] = -eliminated[..., -1] - eliminated[..., :-1] @ step_shared
    return _moved(chain, step_own, step_shared.reshape(joints, 6), noise)


def _damp(matrices: np.ndarray, damping: float) -> None:
    """Marquardt's damping, with a floor for unknowns of which the data say nothing."""
    diagonal = np.einsum("...ii->...i", matrices)  # a view
    diagonal += damping * diagonal + 1e-3


def _jacobians(
    chain: Chain, centres: Float64[np.ndarray, "frames parts 3"], noise: float
) -> tuple[Float64[np.ndarray, "frames parts 6 own"], Float64[np.ndarray, "frames parts 6 shared"]]:
    """d(twist of each part)/d(own unknowns of a frame) and d(...)/d(small rigid motions of the axes).

    An axis that is moved by a twist eta changes its screw motion S to exp(eta) S exp(-eta): the child then
    moves by the twist (1 - Ad_S) eta. Angles in radians, lengths in noise units.
    """
    frames, parts, joints = *centres.shape[:2], len(chain.child)
    Ts_parent = chain.Ts()[:, chain.parent]
    R = Ts_parent[..., :3, :3]
    anchor = chain.point[None]
    q = (R @ anchor[..., None])[..., 0] + Ts_parent[..., :3, 3]  # frames joints 3
    axis = (R @ np.broadcast_to(chain.axis, q.shape)[..., None])[..., 0]
    arms = (centres[:, None] - q[:, :, None]) / noise  # frames joints parts 3
    spin = np.where(chain.revolute[:, None], axis, 0.0)
    slide = np.where(chain.revolute[:, None], 0.0, axis)
    own = np.zeros((frames, parts, 6, joints + 6 * chain.free_root))
    own[..., :3, :joints] = np.broadcast_to(spin[:, :, None], arms.shape).transpose(0, 2, 3, 1)
    own[..., 3:, :joints] = (np.cross(spin[:, :, None], arms) + slide[:, :, None]).transpose(0, 2, 3, 1)
    moves = chain.moves()
    own[..., :joints] *= moves.T[None, :, None, :]

    states = torch.from_numpy(chain.joint_states())
    screws = screw_transform(
        torch.from_numpy(chain.axis)[:, None], torch.from_numpy(chain.point)[:, None], states[..., 0], states[..., 1]
    )
    S = screws.numpy().transpose(1, 0, 2, 3)
    change = np.eye(3) - S[..., :3, :3]  # frames joints 3 3
    carried = ((S[..., :3, :3] @ anchor[..., None])[..., 0] + S[..., :3, 3] - anchor) / noise
    turn = R @ change
    lever = R @ twist_jacobian(carried)[..., :3] @ S[..., :3, :3]  # a slid anchor swings about where it was
    shared = np.zeros((frames, joints, parts, 6, 6))
    shared[..., :3, :3] = turn[:, :, None]
    shared[..., 3:, :3] = twist_jacobian(arms)[..., :3] @ turn[:, :, None] + lever[:, :, None]
    shared[..., 3:, 3:] = turn[:, :, None]
    shared *= moves[None, :, :, None, None]
    if chain.free_root:
        own[..., :3, joints : joints + 3] = np.eye(3)
        own[..., 3:, joints:] = twist_jacobian((centres - chain.T_frame_root[:, None, :3, 3]) / noise)
    return own, shared.transpose(0, 2, 3, 1, 4).reshape(frames, parts, 6, 6 * joints)


def _moved(
    chain: Chain,
    step_own: Float64[np.ndarray, "frames own"],
    step_shared: Float64[np.ndarray, "joints 6"],
    noise: float,
) -> Chain:
    joints = len(chain.child)
    states = chain.states + (step_own[:, :joints] * np.where(chain.revolute, 1.0, noise)).T
    Ts_axis = turn_about(chain.point, step_shared, noise)
    axis = (Ts_axis[:, :3, :3] @ chain.axis[..., None])[..., 0]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    point = (Ts_axis[:, :3, :3] @ chain.point[..., None])[..., 0] + Ts_axis[:, :3, 3]
    T_frame_root = chain.T_frame_root
    if chain.free_root:
        T_frame_root = turn_about(T_frame_root[:, :3, 3], step_own[:, joints:], noise) @ T_frame_root
    return replace(chain, states=states, axis=axis, point=point, T_frame_root=T_frame_root)
