"""Forward kinematics of a tree of screw joints, in the canonical frame's coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from stages.kernels.kinematics.screw import screw_transform


def forward_kinematics(
    T_frame_root: Float[Tensor, "frames 4 4"],
    joints: Sequence[tuple[int, int]],
    axis: Float[Tensor, "joints 3"],
    point: Float[Tensor, "joints 3"],
    states: Float[Tensor, "joints frames 2"],
    root: int,
) -> Float[Tensor, "frames parts 4 4"]:
    """Where each part's canonical points lie in every frame (Eq. 2).

    `joints[j]` = (parent, child), ordered so that a parent's own joint comes first; parts are
    numbered 0..len(joints). `T_frame_root` is the root's own motion. `states[j, t]` = (angle, distance).
    A child's transform is its parent's times the joint's screw motion, since axes and points are given
    where they lie in the canonical frame.
    """
    Ts_joint = screw_transform(axis[:, None], point[:, None], states[..., 0], states[..., 1])
    Ts: dict[int, Tensor] = {root: T_frame_root}
    for joint, (parent, child) in enumerate(joints):
        Ts[child] = Ts[parent] @ Ts_joint[joint]
    return torch.stack([Ts[part] for part in range(len(joints) + 1)], dim=1)
