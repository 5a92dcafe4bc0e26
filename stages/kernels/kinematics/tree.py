"""The kinematic tree: rigid parts that hang on each other by joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64, Int64

from schemas.joints import FREE, JointKind, is_tree, parents_first
from stages.kernels.motion.rigid_motion import from_parts, left_jacobians, rotation_vectors, rotations

WORLD = -1


@dataclass(frozen=True)
class KinematicTree:
    """Rigid parts and joints, where they lie in the canonical frame.

    Joint j moves part `child[j]`, and all that hangs on it, against part `parent[j]`. The root is the part that is
    nobody's child; it stands still, or moves freely in the world where `free_root`.

    The motion of a joint is a rotation vector and a slide: it takes p to R (p - point) + point + slide. The coordinates
    of the tree are the states of all joints, one after the other (schemas.joints), then those of a free root.
    """

    kinds: tuple[JointKind, ...]
    parent: Int64[np.ndarray, "joints"]
    child: Int64[np.ndarray, "joints"]
    axis: Float64[np.ndarray, "joints 3"]
    point: Float64[np.ndarray, "joints 3"]
    root: int
    free_root: bool = False

    def __post_init__(self) -> None:
        """Raises ValueError for joints that do not hang on the root."""
        if not is_tree(self.parent, self.child, self.root):
            raise ValueError(f"found joints that do not hang on the root {self.root}, expected one tree")

    @property
    def parts(self) -> int:
        return len(self.child) + 1

    @property
    def size(self) -> int:
        """How many coordinates the tree has."""
        return len(self.basis)

    @cached_property
    def order(self) -> list[int]:
        """The joints, each after that of its parent."""
        return parents_first(self.parent, self.child)

    @cached_property
    def parents(self) -> Int64[np.ndarray, "parts"]:
        """The parent of each part; -1 for the root."""
        parents = np.full(self.parts, WORLD)
        parents[self.child] = self.parent
        return parents

    @cached_property
    def joint(self) -> Int64[np.ndarray, "coordinates"]:
        """The joint of each coordinate. That of a free root's is the number of joints."""
        return np.repeat(np.arange(len(self._movers)), [kind.size for kind in self._movers])

    @cached_property
    def basis(self) -> Float64[np.ndarray, "coordinates 6"]:
        """The motion that one unit of each coordinate adds to its joint."""
        axes = [*self.axis, np.zeros(3)]
        bases = [kind.basis(axis) for kind, axis in zip(self._movers, axes, strict=False)]
        return np.concatenate([np.zeros((0, 6)), *bases])

    @cached_property
    def balls(self) -> Int64[np.ndarray, "balls 3"]:
        """The coordinates that are rotation vectors."""
        firsts = [first for kind, first in zip(self._movers, self._firsts, strict=False) if kind.is_ball]
        return np.array([range(first, first + 3) for first in firsts], dtype=np.int64).reshape(-1, 3)

    @cached_property
    def angles(self) -> Int64[np.ndarray, "angles"]:
        """The coordinates that are angles about a fixed axis."""
        return np.setdiff1d(np.flatnonzero(self.basis[:, :3].any(axis=1)), self.balls)

    @cached_property
    def moves(self) -> Bool[np.ndarray, "joints parts"]:
        """Which joint moves which part: its child and all that hangs on it."""
        moves = np.zeros((len(self.child), self.parts), dtype=bool)
        for joint in reversed(self.order):
            moves[joint] = moves[self.parent == self.child[joint]].any(axis=0)
            moves[joint, self.child[joint]] = True
        return moves

    @cached_property
    def moved_by(self) -> Bool[np.ndarray, "coordinates parts"]:
        """Which coordinate moves which part."""
        return np.concatenate([self.moves, np.ones((1, self.parts), dtype=bool)])[self.joint]

    def coordinates_of(self, joint: int) -> slice:
        """The coordinates of a joint. Those of a free root follow the last joint's."""
        return slice(self._firsts[joint], self._firsts[joint + 1])

    def units(self, length: float) -> Float64[np.ndarray, "coordinates"]:
        """The unit of each coordinate: one radian, or `length`."""
        return np.concatenate([np.zeros(0), *(kind.units(length) for kind in self._movers)])

    def motions(self, coordinates: Float64[np.ndarray, "poses coordinates"]) -> Float64[np.ndarray, "poses movers 6"]:
        """The rotation vector and the slide of every joint, then those of a free root."""
        return (coordinates @ self._spread).reshape(len(coordinates), len(self._movers), 6)

    def Ts_pose_canonical(
        self, coordinates: Float64[np.ndarray, "poses coordinates"]
    ) -> Float64[np.ndarray, "poses parts 4 4"]:
        """Forward kinematics: where the canonical points of each part lie in each pose (Eq. 2)."""
        Ts_joint = joint_transforms(self._anchors, self.motions(coordinates))
        Ts = np.tile(np.eye(4), (len(coordinates), self.parts, 1, 1))
        if self.free_root:
            Ts[:, self.root] = Ts_joint[:, -1]
        for joint in self.order:
            Ts[:, self.child[joint]] = Ts[:, self.parent[joint]] @ Ts_joint[:, joint]
        return Ts

    def twists(
        self,
        coordinates: Float64[np.ndarray, "poses coordinates"],
        Ts_pose_canonical: Float64[np.ndarray, "poses parts 4 4"],
        additive: bool = True,
    ) -> Float64[np.ndarray, "poses coordinates 6"]:
        """The twist by which each coordinate moves what hangs on its joint, about the origin, angular part first.

        A posed point x moves by omega x x + velocity for a unit change of the coordinate. Changes of a rotation vector
        add to it; unless `additive`, they are turns as seen from outside, as `stepped` takes them.
        """
        motions = self.motions(coordinates)
        T_parent = np.tile(np.eye(4), (*motions.shape[:2], 1, 1))
        T_parent[:, : len(self.parent)] = Ts_pose_canonical[:, self.parent]
        R_parent = T_parent[..., :3, :3]
        anchor = (R_parent @ (self._anchors + motions[..., 3:])[..., None])[..., 0] + T_parent[..., :3, 3]
        turn = R_parent @ left_jacobians(motions[..., :3]) if additive else R_parent
        omega = (turn[:, self.joint] @ self.basis[:, :3, None])[..., 0]
        slide = (R_parent[:, self.joint] @ self.basis[:, 3:, None])[..., 0]
        return np.concatenate([omega, slide - np.cross(omega, anchor[:, self.joint])], axis=-1)

    def stepped(
        self, coordinates: Float64[np.ndarray, "poses coordinates"], step: Float64[np.ndarray, "poses coordinates"]
    ) -> Float64[np.ndarray, "poses coordinates"]:
        """The coordinates after a step. Rotation vectors are turned on by their step, as seen from outside."""
        after = coordinates + step
        for ball in self.balls:
            after[:, ball] = rotation_vectors(rotations(step[:, ball]) @ rotations(coordinates[:, ball]))
        return after

    @cached_property
    def _movers(self) -> tuple[JointKind, ...]:
        """The kinds of all joints, and of a free root's motion in the world."""
        return (*self.kinds, FREE) if self.free_root else self.kinds

    @cached_property
    def _anchors(self) -> Float64[np.ndarray, "movers 3"]:
        return np.concatenate([self.point, np.zeros((int(self.free_root), 3))])

    @cached_property
    def _firsts(self) -> list[int]:
        """The first coordinate of each joint and of a free root, and their number."""
        return [0, *np.cumsum([kind.size for kind in self._movers], dtype=int).tolist()]

    @cached_property
    def _spread(self) -> Float64[np.ndarray, "coordinates movers*6"]:
        spread = np.zeros((self.size, len(self._movers), 6))
        spread[np.arange(self.size), self.joint] = self.basis
        return spread.reshape(self.size, 6 * len(self._movers))


def joint_transforms(
    point: Float64[np.ndarray, "*#batch 3"], motions: Float64[np.ndarray, "*batch 6"]
) -> Float64[np.ndarray, "*batch 4 4"]:
    """The transform of a child against its parent: a turn about the joint's point, then a slide (Eq. 3)."""
    R = rotations(motions[..., :3])
    return from_parts(R, point + motions[..., 3:] - (R @ point[..., None])[..., 0])
