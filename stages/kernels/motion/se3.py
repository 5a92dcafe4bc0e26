"""Rigid transforms as 4 x 4 matrices, in torch, over any leading batch axes."""

from __future__ import annotations

import roma
import torch
from jaxtyping import Float
from torch import Tensor


def from_parts(R: Float[Tensor, "*batch 3 3"], p: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 4 4"]:
    """The transform that turns by R, then moves by p."""
    bottom = R.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(*R.shape[:-2], 1, 4)
    return torch.cat([torch.cat([R, p.unsqueeze(-1)], dim=-1), bottom], dim=-2)


def inverse(T: Float[Tensor, "*batch 4 4"]) -> Float[Tensor, "*batch 4 4"]:
    """The inverse of a rigid transform (no general matrix inversion)."""
    R_inverse = T[..., :3, :3].transpose(-1, -2)
    return from_parts(R_inverse, -(R_inverse @ T[..., :3, 3:]).squeeze(-1))


def transform(T: Float[Tensor, "*batch 4 4"], p: Float[Tensor, "*batch points 3"]) -> Float[Tensor, "*batch points 3"]:
    """Points moved by T; the batch axes of both are broadcast."""
    return p @ T[..., :3, :3].transpose(-1, -2) + T[..., None, :3, 3]


def exp(twist: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 4 4"]:
    """The transform reached by following a twist (angular part first) for unit time."""
    omega, velocity = twist[..., :3], twist[..., 3:]
    return from_parts(roma.rotvec_to_rotmat(omega), (left_jacobian(omega) @ velocity.unsqueeze(-1)).squeeze(-1))


def log(T: Float[Tensor, "*batch 4 4"]) -> Float[Tensor, "*batch 6"]:
    """The twist (angular part first, angle at most pi) that `exp` takes to T."""
    omega = roma.rotmat_to_rotvec(T[..., :3, :3])
    velocity = torch.linalg.solve(left_jacobian(omega), T[..., :3, 3:]).squeeze(-1)
    return torch.cat([omega, velocity], dim=-1)


def skew(v: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """The matrix of the cross product: skew(v) @ w = v x w."""
    x, y, z = v.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).reshape(*v.shape, 3)


def left_jacobian(omega: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Integral of exp(s * omega) over s in [0, 1]: carries a twist's linear part to the translation."""
    squared = (omega * omega).sum(-1)
    small = squared < 1e-8
    safe = torch.where(small, torch.ones_like(squared), squared)
    angle = safe.sqrt()
    # (1 - cos a) / a^2 and (a - sin a) / a^3, by their series near zero
    first = torch.where(small, 0.5 - squared / 24, (1 - angle.cos()) / safe)
    second = torch.where(small, 1 / 6 - squared / 120, (angle - angle.sin()) / (safe * angle))
    cross = skew(omega)
    identity = torch.eye(3, dtype=omega.dtype, device=omega.device)
    return identity + first[..., None, None] * cross + second[..., None, None] * (cross @ cross)
