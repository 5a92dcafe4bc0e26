"""Rearticulation: the joint states that bring a few points of a model to given places (A.7)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64

from schemas.kinematic import KinematicModel
from stages.kernels import se3
from stages.kernels.forward_kinematics import forward_kinematics

STILLNESS = 1e-7
"""Weight of a state's squared change against squared distances: settles what the targets leave open, and
biases the rest by about 1e-5 of the diagonal at most."""

FREE_COLUMNS = {"revolute": (0,), "prismatic": (1,), "screw": (0, 1)}
"""Which of (angle, distance) a joint of each type can change."""


def rearticulate(
    model: KinematicModel,
    p_source: Float64[np.ndarray, "targets 3"],
    parts: Int64[np.ndarray, "targets"],
    p_target: Float64[np.ndarray, "targets 3"],
    free_root: bool = False,
    iterations: int = 200,
) -> tuple[Float64[np.ndarray, "joints 2"], Float64[np.ndarray, "parts 4 4"]]:
    """The states that bring points of the canonical frame, each moving with its part, closest to their targets.

    Normalised frame, radians. Axes stay as they are; the root stays where it is in the canonical frame
    unless `free_root`. Returns the joint states and `Ts_pose_canonical`, where each part's canonical
    points then lie. Least squares by Levenberg-Marquardt from several starts at once: the canonical and
    every observed frame, and quarter turns of all joints so that large motions are found too. Joints of
    which no target tells stay as in the nearest of those frames (A.7).
    """
    problem = _Problem(model, p_source, parts, p_target, free_root)
    poses = problem.starts()
    damping = np.full(len(poses.cost), 1e-3)
    settled = np.zeros(len(poses.cost), dtype=bool)
    for _ in range(iterations):
        step = problem.damped_step(poses, damping)
        trial = problem.pose(problem.moved_root(poses.T_pose_root, step), poses.change + step)
        better = trial.cost < poses.cost
        settled |= np.where(better, poses.cost - trial.cost <= 1e-12 * poses.cost, damping >= 1e9)
        poses = poses.where(better, trial)
        damping = np.where(better, damping / 5, damping * 4).clip(1e-9, 1e9)
        if settled.all():
            break
    best = int(np.argmin(poses.cost))
    return problem.states(poses.change)[:, best], poses.Ts_pose_canonical[best]


@dataclass(frozen=True)
class _Poses:
    """One pose of the model per start. `change` holds the free coordinates' distance from the start's reference."""

    T_pose_root: Float64[np.ndarray, "starts 4 4"]
    change: Float64[np.ndarray, "starts coordinates"]
    Ts_pose_canonical: Float64[np.ndarray, "starts parts 4 4"]
    cost: Float64[np.ndarray, "starts"]

    def where(self, mask: Bool[np.ndarray, "starts"], other: _Poses) -> _Poses:
        """The other's poses where the mask is set, this one's elsewhere."""
        pairs = [(getattr(other, field.name), getattr(self, field.name)) for field in fields(self)]
        return _Poses(*(np.where(mask.reshape(-1, *[1] * (new.ndim - 1)), new, old) for new, old in pairs))


@dataclass(frozen=True)
class _Problem:
    """The least-squares problem. Its coordinates are the joints' free states, then the root's twist if it is free."""

    model: KinematicModel
    p_source: Float64[np.ndarray, "targets 3"]
    parts: Int64[np.ndarray, "targets"]
    p_target: Float64[np.ndarray, "targets 3"]
    free_root: bool

    @cached_property
    def free(self) -> Int64[np.ndarray, "free 2"]:
        """(joint, column of its state) of every free joint coordinate."""
        pairs = [(joint, c) for joint, kind in enumerate(self.model.joint_types) for c in FREE_COLUMNS[kind]]
        return np.array(pairs, dtype=np.int64).reshape(-1, 2)

    @cached_property
    def turning(self) -> Int64[np.ndarray, "turning"]:
        """The coordinates that are angles of joints."""
        return np.flatnonzero(self.free[:, 1] == 0)

    @cached_property
    def moves(self) -> Bool[np.ndarray, "joints parts"]:
        """Which joint moves which part: its child and all that hangs on it."""
        moves = np.zeros((len(self.model.joint_types), self.model.part_count), dtype=bool)
        for joint in reversed(self.model.joints_from_root()):
            child = self.model.joint_child[joint]
            moves[joint] = moves[self.model.joint_parent == child].any(axis=0)
            moves[joint, child] = True
        return moves

    @cached_property
    def reference(self) -> Float64[np.ndarray, "joints starts 2"]:
        """The states that each start is drawn to: canonical for the first three, then the observed frames'."""
        canonical = np.zeros((len(self.model.joint_types), 3, 2))
        return np.concatenate([canonical, self.model.states], axis=1)

    def starts(self) -> _Poses:
        """The canonical frame, every joint a quarter turn either way from it, and the observed frames."""
        starts = self.reference.shape[1]
        change = np.zeros((starts, len(self.free) + 6 * self.free_root))
        change[1, self.turning], change[2, self.turning] = np.pi / 2, -np.pi / 2
        T_pose_root = np.tile(np.eye(4), (starts, 1, 1))
        if self.free_root:
            T_pose_root[3:] = self.model.Ts_frame_canonical[:, self.model.root]
        return self.pose(T_pose_root, change)

    def states(self, change: Float64[np.ndarray, "starts coordinates"]) -> Float64[np.ndarray, "joints starts 2"]:
        states = self.reference.copy()
        states[self.free[:, 0], :, self.free[:, 1]] += change[:, : len(self.free)].T
        return states

    def moved_root(
        self, T_pose_root: Float64[np.ndarray, "starts 4 4"], step: Float64[np.ndarray, "starts coordinates"]
    ) -> Float64[np.ndarray, "starts 4 4"]:
        if not self.free_root:
            return T_pose_root
        return se3.exp(torch.from_numpy(step[:, -6:])).numpy() @ T_pose_root

    def pose(
        self, T_pose_root: Float64[np.ndarray, "starts 4 4"], change: Float64[np.ndarray, "starts coordinates"]
    ) -> _Poses:
        """Forward kinematics and the cost: squared distances to the targets, and the squared change."""
        change = change.copy()
        change[:, self.turning] = (change[:, self.turning] + np.pi) % (2 * np.pi) - np.pi  # no whole turns
        order = self.model.joints_from_root()
        Ts = forward_kinematics(
            torch.from_numpy(T_pose_root),
            [(int(self.model.joint_parent[joint]), int(self.model.joint_child[joint])) for joint in order],
            torch.from_numpy(self.model.axis[order]),
            torch.from_numpy(self.model.point[order]),
            torch.from_numpy(self.states(change)[order]),
            self.model.root,
        ).numpy()
        distance2 = ((self.posed(Ts) - self.p_target) ** 2).sum(axis=(1, 2))
        return _Poses(T_pose_root, change, Ts, distance2 + STILLNESS * (change**2).sum(axis=1))

    def posed(self, Ts: Float64[np.ndarray, "starts parts 4 4"]) -> Float64[np.ndarray, "starts targets 3"]:
        """Where the source points lie."""
        return _transform(Ts[:, self.parts], self.p_source)

    def damped_step(
        self, poses: _Poses, damping: Float64[np.ndarray, "starts"]
    ) -> Float64[np.ndarray, "starts coordinates"]:
        """The Gauss-Newton step of every start, shortened by Marquardt's damping of the normal matrix' diagonal."""
        p = self.posed(poses.Ts_pose_canonical)
        jacobian = self._jacobian(poses.Ts_pose_canonical, p)
        residual = (p - self.p_target).reshape(len(p), -1, 1)
        gradient = jacobian @ residual + STILLNESS * poses.change[..., None]
        normal = jacobian @ jacobian.transpose(0, 2, 1)
        diagonal = np.einsum("scc->sc", normal)  # a view
        diagonal += STILLNESS
        diagonal *= 1 + damping[:, None]
        return -np.linalg.solve(normal, gradient)[..., 0]

    def _jacobian(
        self, Ts: Float64[np.ndarray, "starts parts 4 4"], p: Float64[np.ndarray, "starts targets 3"]
    ) -> Float64[np.ndarray, "starts coordinates residuals"]:
        """How fast the posed points move: axis x (p - point) for a turn, axis for a slide, where a joint moves them."""
        Ts_parent = Ts[:, self.model.joint_parent]
        point = _transform(Ts_parent, self.model.point)
        axis = _transform(Ts_parent, self.model.point + self.model.axis) - point
        slide = np.broadcast_to(axis[:, :, None], (*axis.shape[:2], *p.shape[1:]))
        turn = np.cross(slide, p[:, None] - point[:, :, None])
        columns = np.stack([turn, slide], axis=2) * self.moves[:, self.parts][:, None, :, None]
        jacobian = columns[:, self.free[:, 0], self.free[:, 1]]
        if self.free_root:
            slide = np.broadcast_to(np.eye(3)[:, None], (len(p), 3, *p.shape[1:]))
            jacobian = np.concatenate([jacobian, np.cross(slide, p[:, None]), slide], axis=1)
        return jacobian.reshape(*jacobian.shape[:2], p[0].size)


def _transform(Ts: Float64[np.ndarray, "*batch 4 4"], p: Float64[np.ndarray, "*batch 3"]) -> np.ndarray:
    """Each point by its own transform."""
    return (Ts[..., :3, :3] @ p[..., None])[..., 0] + Ts[..., :3, 3]
