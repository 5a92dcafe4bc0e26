"""Screw motions: turning by an angle about an axis while moving a distance along it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import roma
import torch
from jaxtyping import Float
from torch import Tensor

from stages.kernels.motion import se3


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


@dataclass(frozen=True)
class ScrewFit:
    """The screw joint that best explains a relative motion; batch axes as of the motion.

    `states[..., t, :]` = (angle in radians, distance); `residual` is the mean, over frames and points, of
    the squared distance between where the motion and the screw take a point.
    """

    axis: Float[Tensor, "*batch 3"]
    point: Float[Tensor, "*batch 3"]
    states: Float[Tensor, "*batch frames 2"]
    residual: Float[Tensor, "*batch"]


def fit_screw(
    Ts: Float[Tensor, "*batch frames 4 4"],
    p: Float[Tensor, "*batch points 3"],
    kind: Literal["screw", "revolute", "prismatic"] = "screw",
) -> ScrewFit:
    """The screw joint nearest to a sequence of relative motions, in closed form (Eq. 12).

    The axis is the principal direction of the rotation vectors (revolute), of the translations of the
    points' centre (prismatic), or whichever of the two leaves less (screw); angles, distances and the
    axis' position then follow by least squares. `p` are the moving part's points, at which deviations
    are measured: that makes angles and lengths comparable without a unit.
    """
    centre = p.mean(dim=-2)
    moved = (Ts[..., :3, :3] @ centre[..., None, :, None]).squeeze(-1) + Ts[..., :3, 3]
    translations = moved - centre[..., None, :]
    rotations = roma.rotmat_to_rotvec(Ts[..., :3, :3])
    fits = []
    if kind in ("screw", "revolute"):
        fits.append(_fit_about(_principal_direction(rotations), Ts, p, centre, translations, kind))
    if kind in ("screw", "prismatic"):
        fits.append(_fit_about(_principal_direction(translations), Ts, p, centre, translations, kind))
    if len(fits) == 1:
        return fits[0]
    better = fits[1].residual < fits[0].residual
    return ScrewFit(
        axis=torch.where(better[..., None], fits[1].axis, fits[0].axis),
        point=torch.where(better[..., None], fits[1].point, fits[0].point),
        states=torch.where(better[..., None, None], fits[1].states, fits[0].states),
        residual=torch.where(better, fits[1].residual, fits[0].residual),
    )


def _principal_direction(v: Float[Tensor, "*batch frames 3"]) -> Float[Tensor, "*batch 3"]:
    """The unit direction along which the vectors are longest, its greatest component positive; z when all are zero."""
    scatter = v.transpose(-1, -2) @ v
    direction = torch.linalg.eigh(scatter)[1][..., 2]
    greatest = direction.gather(-1, direction.abs().argmax(dim=-1, keepdim=True))
    return torch.where(greatest < 0, -direction, direction)


def _fit_about(
    axis: Float[Tensor, "*batch 3"],
    Ts: Float[Tensor, "*batch frames 4 4"],
    p: Float[Tensor, "*batch points 3"],
    centre: Float[Tensor, "*batch 3"],
    translations: Float[Tensor, "*batch frames 3"],
    kind: str,
) -> ScrewFit:
    """The best screw with a given axis direction."""
    along = axis[..., None, :]
    quaternion = roma.rotmat_to_unitquat(Ts[..., :3, :3])
    angle = 2 * torch.atan2((quaternion[..., :3] * along).sum(-1), quaternion[..., 3])
    angle = _unwrapped(torch.remainder(angle + torch.pi, 2 * torch.pi) - torch.pi)
    distance = (translations * along).sum(-1)
    if kind == "prismatic":
        angle = torch.zeros_like(angle)
    if kind == "revolute":
        distance = torch.zeros_like(distance)
    # the centre moves by (R - I)(centre - point) across the axis: least squares for point - centre
    R = roma.rotvec_to_rotmat(along * angle[..., None])
    identity = torch.eye(3, dtype=R.dtype, device=R.device)
    across = translations - along * (translations * along).sum(-1, keepdim=True)
    A = identity - R
    normal = (A.transpose(-1, -2) @ A).sum(-3)
    normal = normal + axis[..., :, None] * axis[..., None, :]  # pins the position along the axis
    damping = 1e-9 + 1e-6 * normal.diagonal(dim1=-2, dim2=-1).mean(-1)
    right = (A.transpose(-1, -2) @ across[..., None]).sum(-3)
    offset = torch.linalg.solve(normal + damping[..., None, None] * identity, right).squeeze(-1)
    point = nearest_point_to_origin(axis, centre + offset)
    fitted = screw_transform(along, point[..., None, :], angle, distance)
    deviation = se3.transform(Ts, p[..., None, :, :]) - se3.transform(fitted, p[..., None, :, :])
    residual = deviation.square().sum(-1).mean(dim=(-1, -2))
    return ScrewFit(axis, point, torch.stack([angle, distance], dim=-1), residual)


def _unwrapped(angle: Float[Tensor, "*batch frames"]) -> Float[Tensor, "*batch frames"]:
    """Angles without jumps of whole turns between frames; the frame with the least angle keeps its own."""
    jumps = torch.round(torch.diff(angle, dim=-1) / (2 * torch.pi))
    turns = torch.cat([torch.zeros_like(angle[..., :1]), -torch.cumsum(jumps, dim=-1)], dim=-1)
    still = angle.abs().argmin(dim=-1, keepdim=True)
    return angle + 2 * torch.pi * (turns - turns.gather(-1, still))
