"""A model as it can be posed: its tree, the poses that were seen, and the limits of its joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from schemas.kinematic import KinematicModel
from stages.kernels.kinematics.chain import Chain, Joint
from stages.kernels.kinematics.tree import KinematicTree


@dataclass(frozen=True)
class Mechanism:
    """A chain of the normalised frame, and bounds of its coordinates.

    Bounds are infinite where there are none. That of a rotation vector is of its length, given thrice.
    """

    chain: Chain
    lower: Float64[np.ndarray, "coordinates"]
    upper: Float64[np.ndarray, "coordinates"]

    @classmethod
    def without_limits(cls, chain: Chain) -> Mechanism:
        """A chain whose joints go as far as they are asked to."""
        unbounded = np.full(chain.tree.size, np.inf)
        return cls(chain, -unbounded, unbounded)

    @property
    def tree(self) -> KinematicTree:
        return self.chain.tree


def chain_of(model: KinematicModel, free_root: bool) -> Chain:
    """The chain of a kinematic model. Its root stays where it is in the canonical frame unless it is free."""
    joints = [
        Joint(kind, int(parent), int(child), axis, point, model.states_of(index))
        for index, (kind, parent, child, axis, point) in enumerate(
            zip(model.kinds, model.joint_parent, model.joint_child, model.axis, model.point, strict=True)
        )
    ]
    return Chain.of(joints, model.root, model.Ts_frame_canonical[:, model.root], free_root)


def root_moves(T_frame_root: Float64[np.ndarray, "frames 4 4"]) -> bool:
    """Whether a root, in the normalised frame, is elsewhere in some frame than in the canonical one."""
    return not np.allclose(T_frame_root, np.eye(4), atol=1e-6)
