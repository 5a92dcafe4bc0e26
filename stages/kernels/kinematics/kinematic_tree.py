"""A tree of rigid parts and of joints of every kind, posed by numpy alone: torch takes seconds to import."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64, Int64

WORLD = -1
"""The parent of a root that is free to move."""


@dataclass(frozen=True)
class KinematicTree:
    """Rigid parts that hang on each other by joints, where they lie in the canonical frame.

    Joint j moves part `child[j]`, and all that hangs on it, against `parent[j]`, a part or the WORLD; a part that is
    nobody's child stands still. A joint's motion is a rotation vector and a slide: it takes p to
    R (p - point) + point + slide. `basis[c]` is the motion that one unit of coordinate c adds to joint `joint[c]`.
    """

    parts: int
    parent: Int64[np.ndarray, "joints"]
    child: Int64[np.ndarray, "joints"]
    point: Float64[np.ndarray, "joints 3"]
    joint: Int64[np.ndarray, "coordinates"]
    basis: Float64[np.ndarray, "coordinates 6"]

    @cached_property
    def order(self) -> list[int]:
        """The joints, each after its parent's own."""
        roots = sorted(set(range(self.parts)) - set(self.child.tolist()))
        order: list[int] = []
        front = [WORLD, *roots]
        while front:
            here = np.flatnonzero(self.parent == front.pop())
            order += here.tolist()
            front += self.child[here].tolist()
        return order

    @cached_property
    def moves(self) -> Bool[np.ndarray, "joints parts"]:
        """Which joint moves which part: its child and all that hangs on it."""
        return moved_parts(self.parent, self.child, self.parts, self.order)

    @cached_property
    def _spread(self) -> Float64[np.ndarray, "coordinates joints*6"]:
        spread = np.zeros((len(self.joint), len(self.child), 6))
        spread[np.arange(len(self.joint)), self.joint] = self.basis
        return spread.reshape(len(self.joint), 6 * len(self.child))

    def motions(self, coordinates: Float64[np.ndarray, "poses coordinates"]) -> Float64[np.ndarray, "poses joints 6"]:
        """Every joint's rotation vector and slide."""
        return (coordinates @ self._spread).reshape(len(coordinates), len(self.child), 6)

    def Ts_pose_canonical(
        self, coordinates: Float64[np.ndarray, "poses coordinates"]
    ) -> Float64[np.ndarray, "poses parts 4 4"]:
        """Where each part's canonical points lie in each pose (Eq. 2)."""
        motions = self.motions(coordinates)
        R = rotations(motions[..., :3])[0]
        Ts_joint = np.zeros((*R.shape[:2], 4, 4))
        Ts_joint[..., :3, :3], Ts_joint[..., 3, 3] = R, 1.0
        Ts_joint[..., :3, 3] = self.point + motions[..., 3:] - (R @ self.point[..., None])[..., 0]
        Ts = np.tile(np.eye(4), (len(coordinates), self.parts, 1, 1))
        for joint in self.order:
            T_parent = np.eye(4) if self.parent[joint] == WORLD else Ts[:, self.parent[joint]]
            Ts[:, self.child[joint]] = T_parent @ Ts_joint[:, joint]
        return Ts

    def twists(
        self,
        coordinates: Float64[np.ndarray, "poses coordinates"],
        Ts_pose_canonical: Float64[np.ndarray, "poses parts 4 4"],
    ) -> Float64[np.ndarray, "poses coordinates 6"]:
        """The twist, angular part first and about the origin, by which each coordinate moves what hangs on its joint.

        A posed point x of such a part moves by omega x x + velocity for a unit change of the coordinate.
        """
        motions = self.motions(coordinates)
        T_parent = np.where((self.parent == WORLD)[:, None, None], np.eye(4), Ts_pose_canonical[:, self.parent])
        R_parent = T_parent[..., :3, :3]
        anchor = (R_parent @ (self.point + motions[..., 3:])[..., None])[..., 0] + T_parent[..., :3, 3]
        turn = R_parent @ rotations(motions[..., :3])[1]
        omega = (turn[:, self.joint] @ self.basis[:, :3, None])[..., 0]
        slide = (R_parent[:, self.joint] @ self.basis[:, 3:, None])[..., 0]
        return np.concatenate([omega, slide - np.cross(omega, anchor[:, self.joint])], axis=-1)


def moved_parts(
    parent: Int64[np.ndarray, "joints"], child: Int64[np.ndarray, "joints"], parts: int, order: Sequence[int]
) -> Bool[np.ndarray, "joints parts"]:
    """Which joint moves which part: its child and all that hangs on it. In `order`, parents' own come first."""
    moves = np.zeros((len(child), parts), dtype=bool)
    for joint in reversed(order):
        moves[joint] = moves[parent == child[joint]].any(axis=0)
        moves[joint, child[joint]] = True
    return moves


def rotations(
    rotation_vectors: Float64[np.ndarray, "*batch 3"],
) -> tuple[Float64[np.ndarray, "*batch 3 3"], Float64[np.ndarray, "*batch 3 3"]]:
    """Rotation matrices, and the left Jacobians J: a rotation vector's change d turns by J d, seen from outside."""
    x, y, z = np.moveaxis(rotation_vectors, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    squared = x * x + y * y + z * z
    angle = np.sqrt(squared)
    # sin a / a, (1 - cos a) / a^2 and (a - sin a) / a^3, finite at zero
    first, second = np.sinc(angle / np.pi), np.sinc(angle / (2 * np.pi)) ** 2 / 2
    third = np.where(squared < 1e-4, 1 / 6 - squared / 120, (1 - first) / np.maximum(squared, 1e-4))
    square = cross @ cross
    R = np.eye(3) + first[..., None, None] * cross + second[..., None, None] * square
    return R, np.eye(3) + second[..., None, None] * cross + third[..., None, None] * square
