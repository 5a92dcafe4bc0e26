"""A model as it can be posed: its tree, the poses that were seen, and the limits of its joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from stages.kernels.kinematics.chain import Chain
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
