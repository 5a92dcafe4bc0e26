"""A model as it can be posed: its joints' coordinates, whatever the kinds of the joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import Rotation

from schemas.kinematic import KinematicModel
from stages.kernels.kinematics.kinematic_tree import WORLD, KinematicTree

FREE_COLUMNS = {"revolute": [0], "prismatic": [1], "screw": [0, 1]}
"""Which of (angle, distance) a joint of each type can change."""


@dataclass(frozen=True)
class Mechanism:
    """A model as it can be posed: its tree, and its coordinates in every observed frame.

    Normalised frame, radians. The coordinates are those of the joints one after the other: an angle (revolute), a
    distance (prismatic), both (screw) or a rotation vector (spherical); then a free root's rotation vector and slide.
    Bounds are infinite where there are none; a rotation vector's is of its length, given thrice.
    """

    tree: KinematicTree
    observed: Float64[np.ndarray, "frames coordinates"]
    lower: Float64[np.ndarray, "coordinates"]
    upper: Float64[np.ndarray, "coordinates"]

    @classmethod
    def of(cls, model: KinematicModel, free_root: bool) -> Self:
        """A kinematic model without limits; its root stays where it is in the canonical frame unless it is free."""
        return cls.assembled(
            links=np.stack([model.joint_parent, model.joint_child], axis=1),
            types=model.joint_types,
            axis=model.axis,
            point=model.point,
            states=[model.states[j][:, FREE_COLUMNS[kind]] for j, kind in enumerate(model.joint_types)],
            T_frame_root=model.Ts_frame_canonical[:, model.root],
            free_root=model.root if free_root else None,
        )

    @classmethod
    def assembled(
        cls,
        *,
        links: Int64[np.ndarray, "joints 2"],
        types: Sequence[str],
        axis: Float64[np.ndarray, "joints 3"],
        point: Float64[np.ndarray, "joints 3"],
        states: Sequence[Float64[np.ndarray, "frames _"]],
        T_frame_root: Float64[np.ndarray, "frames 4 4"],
        free_root: int | None,
    ) -> Self:
        """A mechanism without limits of (parent, child) links; `states` has a column for each coordinate of a joint."""
        bases = [_basis(kind, direction) for kind, direction in zip(types, axis, strict=True)]
        observed, parts = list(states), len(links) + 1
        if free_root is not None:
            links = np.concatenate([links, [[WORLD, free_root]]])
            point = np.concatenate([point, np.zeros((1, 3))])
            turns = Rotation.from_matrix(T_frame_root[:, :3, :3]).as_rotvec()
            bases.append(np.eye(6))
            observed.append(np.concatenate([turns, T_frame_root[:, :3, 3]], axis=1))
        sizes = [len(basis) for basis in bases]
        unbounded = np.full(sum(sizes), np.inf)
        return cls(
            tree=KinematicTree(
                parts=parts,
                parent=links[:, 0],
                child=links[:, 1],
                point=point,
                joint=np.repeat(np.arange(len(bases)), sizes),
                basis=np.concatenate([np.zeros((0, 6)), *bases]),
            ),
            observed=np.concatenate([np.zeros((len(T_frame_root), 0)), *observed], axis=1),
            lower=-unbounded,
            upper=unbounded,
        )

    def coordinates_of(self, joint: int) -> Int64[np.ndarray, "own"]:
        """A joint's own coordinates; a free root's follow those of the last joint."""
        return np.flatnonzero(self.tree.joint == joint)

    @cached_property
    def balls(self) -> Int64[np.ndarray, "balls 3"]:
        """The coordinates that are rotation vectors: of spherical joints, and of a free root."""
        threes = [own[:3] for own in map(self.coordinates_of, range(len(self.tree.child))) if len(own) >= 3]
        return np.array(threes, dtype=np.int64).reshape(-1, 3)

    @cached_property
    def angles(self) -> Int64[np.ndarray, "angles"]:
        """The coordinates that are angles about a fixed axis."""
        turning = np.flatnonzero(self.tree.basis[:, :3].any(axis=1))
        return np.setdiff1d(turning, self.balls)


def _basis(kind: str, axis: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "own 6"]:
    """What each coordinate of a joint adds to its motion."""
    if kind == "spherical":
        return np.eye(3, 6)
    basis: np.ndarray = np.kron(np.eye(2), axis)[FREE_COLUMNS[kind]]
    return basis


def root_moves(T_frame_root: Float64[np.ndarray, "frames 4 4"]) -> bool:
    """Whether a root, in the normalised frame, is elsewhere in some frame than in the canonical one."""
    return not np.allclose(T_frame_root, np.eye(4), atol=1e-6)
