"""Screw motions: turning by an angle about an axis while moving a distance along it."""

from __future__ import annotations

import roma
import torch
from jaxtyping import Float
from torch import Tensor

from stages.kernels import se3


def screw_transform(
    axis: Float[Tensor, "*batch 3"],
    point: Float[Tensor, "*batch 3"],
    angle: Float[Tensor, "*batch"],
    distance: Float[Tensor, "*batch"],
) -> Float[Tensor, "*batch 4 4"]:
    """The motion of a screw joint: `angle` (radians) about the axis through `point`, `distance` along it.

    `axis` is of unit length. All batch axes are broadcast. Eq. 3's T(s, theta) with theta = (angle, distance).
    """
    R = roma.rotvec_to_rotmat(axis * angle.unsqueeze(-1))
    turned = (R @ point.unsqueeze(-1)).squeeze(-1)
    return se3.from_parts(R, point - turned + axis * distance.unsqueeze(-1))


def nearest_point_to_origin(
    axis: Float[Tensor, "*batch 3"], point: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """The point of the line through `point` along the unit `axis` that lies nearest the origin."""
    return point - axis * (point * axis).sum(-1, keepdim=True)
