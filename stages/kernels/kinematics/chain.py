"""A kinematic tree with its states in every frame, and its fit to all frames at once by Levenberg-Marquardt."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float64

from schemas.joints import JointKind
from stages.kernels.alignment.registration import NormalEquations, turn_about
from stages.kernels.kinematics.closed_form import JointFit
from stages.kernels.kinematics.tree import KinematicTree
from stages.kernels.motion.rigid_motion import rotation_vectors, rotations, skew

DAMPING_FIRST, DAMPING_LEAST, DAMPING_MOST = 1e-3, 1e-6, 1e4
LEAST_FALL = 1e-5  # relative fall of the cost below which a fit has ended


@dataclass(frozen=True)
class Joint:
    """One joint of a chain, and its states (frames, size) as its kind says (schemas.joints)."""

    kind: JointKind
    parent: int
    child: int
    axis: Float64[np.ndarray, "3"]
    point: Float64[np.ndarray, "3"]
    states: Float64[np.ndarray, "frames size"]

    @classmethod
    def of(cls, fit: JointFit, parent: int, child: int, index: tuple[int, ...] = ()) -> Joint:
        """A joint that was fitted to a relative motion."""
        return cls(fit.kind_of(index), parent, child, fit.axis[index], fit.point[index], fit.states_of(index))


@dataclass(frozen=True)
class Chain:
    """A kinematic tree, and its coordinates in every frame: zero in the canonical one."""

    tree: KinematicTree
    states: Float64[np.ndarray, "frames coordinates"]

    @classmethod
    def of(
        cls, joints: Sequence[Joint], root: int, T_frame_root: Float64[np.ndarray, "frames 4 4"], free_root: bool
    ) -> Chain:
        """Joints put together to a tree. The root stands still unless it is free."""
        tree = KinematicTree(
            kinds=tuple(joint.kind for joint in joints),
            parent=np.array([joint.parent for joint in joints], dtype=np.int64),
            child=np.array([joint.child for joint in joints], dtype=np.int64),
            axis=np.array([joint.axis for joint in joints]).reshape(-1, 3),
            point=np.array([joint.point for joint in joints]).reshape(-1, 3),
            root=root,
            free_root=free_root,
        )
        states = [np.zeros((len(T_frame_root), 0)), *(joint.states for joint in joints)]
        if free_root:
            states += [rotation_vectors(T_frame_root[:, :3, :3]), T_frame_root[:, :3, 3]]
        return cls(tree, np.concatenate(states, axis=1))

    @cached_property
    def Ts(self) -> Float64[np.ndarray, "frames parts 4 4"]:
        """Where the canonical points of each part lie in every frame."""
        return self.tree.Ts_pose_canonical(self.states)

    @property
    def parts(self) -> int:
        return self.tree.parts

    @property
    def T_frame_root(self) -> Float64[np.ndarray, "frames 4 4"]:
        """The root's own motion."""
        return self.Ts[:, self.tree.root]

    @property
    def joint_states(self) -> Float64[np.ndarray, "frames coordinates"]:
        """The states of all joints, without a free root's."""
        return self.states[:, : sum(kind.size for kind in self.tree.kinds)]

    def states_of(self, joint: int) -> Float64[np.ndarray, "frames size"]:
        """The states of one of the joints."""
        return self.states[:, self.tree.coordinates_of(joint)]

    def joint(self, index: int) -> Joint:
        """One of the joints."""
        tree = self.tree
        parent, child = int(tree.parent[index]), int(tree.child[index])
        return Joint(tree.kinds[index], parent, child, tree.axis[index], tree.point[index], self.states_of(index))

    def joints(self) -> list[Joint]:
        """All joints, in their order."""
        return [self.joint(index) for index in range(len(self.tree.child))]

    def with_joints(self, joints: Sequence[Joint]) -> Chain:
        """The same root with other joints."""
        return Chain.of(joints, self.tree.root, self.T_frame_root, self.tree.free_root)


Linearise = Callable[[Float64[np.ndarray, "frames parts 4 4"]], NormalEquations]


def fit_chain(chain: Chain, linearise: Linearise, canonical_frame: int, spacing: float, iterations: int) -> Chain:
    """Axes, points and states at which the data's cost is least, by damped Gauss-Newton steps.

    `linearise` gives cost and normal equations of parts' motions; it may match points anew at every call. The
    canonical frame keeps its zero states. Ends when the cost no longer falls, or after `iterations` trials.
    """
    others = np.arange(len(chain.states)) != canonical_frame
    if chain.tree.size == 0:
        return chain
    equations = linearise(chain.Ts)
    damping = DAMPING_FIRST
    for _ in range(iterations):
        trial = _step(chain, equations, others, spacing, damping)
        there = linearise(trial.Ts)
        if there.cost < equations.cost:
            settled = equations.cost - there.cost < LEAST_FALL * abs(equations.cost)
            chain, equations, damping = trial, there, max(damping / 5, DAMPING_LEAST)
            if settled:
                break
        elif damping >= DAMPING_MOST:
            break
        else:
            damping *= 8
    return chain


def _step(chain: Chain, equations: NormalEquations, others: np.ndarray, spacing: float, damping: float) -> Chain:
    """One damped Gauss-Newton step.

    Unknowns are every frame's own states and, shared by all frames, a small rigid motion of each axis. The frames' own
    unknowns are eliminated first, so that time is linear in frames.
    """
    own, shared = (jacobian[others] for jacobian in jacobians(chain, equations.centres, spacing))
    frames, rows = int(others.sum()), 6 * chain.parts
    A, B, C = normal_blocks(own, shared, equations.hessian[others])
    gradient = equations.gradient[others].reshape(frames, rows)
    own, shared = (jacobian.reshape(frames, rows, jacobian.shape[-1]) for jacobian in (own, shared))
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
    return _stepped(chain, step_own, step_shared.reshape(-1, 6), spacing)


def normal_blocks(
    own: Float64[np.ndarray, "frames parts 6 own"],
    shared: Float64[np.ndarray, "frames parts 6 shared"],
    hessian: Float64[np.ndarray, "frames parts 6 6"],
) -> tuple[
    Float64[np.ndarray, "frames own own"],
    Float64[np.ndarray, "frames own shared"],
    Float64[np.ndarray, "shared shared"],
]:
    """The normal matrix in blocks: each frame's own unknowns, these against the shared ones, the shared ones.

    `own` and `shared` are Jacobians of parts' twists (`jacobians`), and `hessian` says how dear these twists are.
    """
    frames, rows = len(hessian), 6 * hessian.shape[1]
    weighted = [np.matmul(hessian, jacobian).reshape(frames, rows, jacobian.shape[-1]) for jacobian in (own, shared)]
    own, shared = (jacobian.reshape(frames, rows, jacobian.shape[-1]) for jacobian in (own, shared))
    A, B = (own.transpose(0, 2, 1) @ columns for columns in weighted)
    return A, B, (shared.transpose(0, 2, 1) @ weighted[1]).sum(axis=0)


def _damp(matrices: np.ndarray, damping: float) -> None:
    """Marquardt's damping, with a floor for unknowns of which the data say nothing."""
    diagonal = np.einsum("...ii->...i", matrices)  # a view
    diagonal += damping * diagonal + 1e-3


def jacobians(
    chain: Chain, centres: Float64[np.ndarray, "frames parts 3"], spacing: float
) -> tuple[Float64[np.ndarray, "frames parts 6 own"], Float64[np.ndarray, "frames parts 6 shared"]]:
    """d(twist of each part)/d(own unknowns of a frame) and d(...)/d(small rigid motions of the axes).

    Twists of parts turn about their centres. An axis that is moved by a twist eta changes its joint's motion S to
    exp(eta) S exp(-eta): the child then moves by the twist (1 - Ad_S) eta. Angles in radians, lengths in spacings.
    """
    tree, frames, parts = chain.tree, *centres.shape[:2]
    joints = len(tree.child)
    twists = tree.twists(chain.states, chain.Ts, additive=False)[:, None]  # frames 1 coordinates 6
    own = np.empty((frames, parts, tree.size, 6))
    own[..., :3] = twists[..., :3]
    own[..., 3:] = (twists[..., 3:] + np.cross(twists[..., :3], centres[:, :, None])) / spacing
    own *= tree.units(spacing)[:, None] * tree.moved_by.T[None, :, :, None]

    motions = tree.motions(chain.states)[:, :joints]
    S, T_parent = rotations(motions[..., :3]), chain.Ts[:, tree.parent]
    R = T_parent[..., :3, :3]
    anchor = (R @ tree.point[..., None])[..., 0] + T_parent[..., :3, 3]
    arms = (centres[:, None] - anchor[:, :, None]) / spacing  # frames joints parts 3
    change = R @ (np.eye(3) - S)
    lever = R @ -skew(motions[..., 3:] / spacing) @ S  # a slid anchor swings about where it was
    shared = np.zeros((frames, joints, parts, 6, 6))
    shared[..., :3, :3] = change[:, :, None]
    shared[..., 3:, :3] = -skew(arms) @ change[:, :, None] + lever[:, :, None]
    shared[..., 3:, 3:] = change[:, :, None]
    shared *= tree.moves[None, :, :, None, None]
    shared[:, [not kind.has_axis for kind in tree.kinds], :, :, :3] = 0.0  # what has no direction is not turned
    return own.swapaxes(2, 3), shared.transpose(0, 2, 3, 1, 4).reshape(frames, parts, 6, 6 * joints)


def _stepped(
    chain: Chain,
    step_own: Float64[np.ndarray, "frames own"],
    step_shared: Float64[np.ndarray, "joints 6"],
    spacing: float,
) -> Chain:
    tree = chain.tree
    Ts_axis = turn_about(tree.point, step_shared, spacing)
    axis = (Ts_axis[:, :3, :3] @ tree.axis[..., None])[..., 0]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    point = (Ts_axis[:, :3, :3] @ tree.point[..., None])[..., 0] + Ts_axis[:, :3, 3]
    states = tree.stepped(chain.states, step_own * tree.units(spacing))
    return Chain(replace(tree, axis=axis, point=point), states)
