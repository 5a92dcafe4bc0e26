"""The final fit: joint types made exact, then E_recons minimised under forward kinematics (A.4)."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor, nn

from schemas.config import FinalFitConfig
from schemas.flow import Flow
from schemas.kinematic import KinematicModel, LinkType
from schemas.sequence import PointSequence
from stages.energy import ReconstructionEnergy
from stages.kernels import se3
from stages.kernels.forward_kinematics import forward_kinematics
from stages.kernels.sampling import spacing
from stages.kernels.screw import ScrewFit, fit_screw, nearest_point_to_origin
from stages.progress import Progress, silent
from stages.projection import part_samples

REPORT_EVERY = 10


def fit_final(
    model: KinematicModel,
    sequence: PointSequence,
    flow: Flow,
    config: FinalFitConfig,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> KinematicModel:
    """Decide each joint's type, then fit axes, states and the root's motion to the frames.

    The segmentation and the tree stay as they are. The answer's motions are exactly those of forward
    kinematics, and each joint's other coordinate is exactly zero. Deterministic; `rng` is not drawn from.
    """
    p_canonical = sequence.frames()[model.canonical_frame]
    typed = decide_joint_types(model, p_canonical, config.samples_per_part)
    chain = ArticulatedMotion(typed, root_moves=root_moves(typed, p_canonical, config.still_root))
    energy = ReconstructionEnergy(
        sequence, flow, model.canonical_frame, config.energy, config.points, config.iterations
    )
    labels = torch.from_numpy(typed.labels[energy.index])
    p_points = torch.from_numpy(energy.p_canonical)
    optimizer = torch.optim.Adam(chain.parameters(), lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, max(config.iterations, 1))
    row = [float("nan")] * 4
    for step in range(config.iterations):
        Ts = chain()
        predicted = se3.transform(Ts[:, labels], p_points[:, None])[..., 0, :]
        terms = energy(predicted, step)
        if terms.total.requires_grad:  # one part that stands still has nothing to fit
            optimizer.zero_grad()
            terms.total.backward()
            optimizer.step()
            schedule.step()
        if step % REPORT_EVERY == 0 or step == config.iterations - 1:
            row = terms.row()
            progress(step + 1, config.iterations, row[0])
    names = ("E_recons", "E_CD", "E_EMD", "E_flow")
    energies = dict(zip(names, row, strict=True)) if config.iterations else {}
    return chain.to_model(typed, energies)


def decide_joint_types(
    model: KinematicModel, p_canonical: Float64[np.ndarray, "points 3"], samples_per_part: int
) -> KinematicModel:
    """Each joint made revolute or prismatic: whichever motion explains the child's better.

    Both hypotheses are judged by how far they leave the child's points from where they were seen, so
    that the choice knows no unit (where A.4 compares an angle with a length).
    """
    samples = torch.from_numpy(part_samples(p_canonical, model.labels, samples_per_part))[model.joint_child]
    Ts = torch.from_numpy(model.Ts_frame_canonical).transpose(0, 1)
    Ts_parent_child = se3.inverse(Ts[model.joint_parent]) @ Ts[model.joint_child]
    fits: dict[LinkType, ScrewFit] = {
        "revolute": fit_screw(Ts_parent_child, samples, "revolute"),
        "prismatic": fit_screw(Ts_parent_child, samples, "prismatic"),
    }
    types: list[LinkType] = [
        "prismatic" if slide < turn else "revolute"
        for turn, slide in zip(fits["revolute"].residual.tolist(), fits["prismatic"].residual.tolist(), strict=True)
    ]
    axis, point, states = model.axis.copy(), model.point.copy(), model.states.copy()
    for joint, kind in enumerate(types):
        axis[joint] = fits[kind].axis[joint].numpy()
        point[joint] = fits[kind].point[joint].numpy()
        states[joint] = fits[kind].states[joint].numpy()
    return model.replace(joint_types=tuple(types), axis=axis, point=point, states=states)


def root_moves(model: KinematicModel, p_canonical: Float64[np.ndarray, "points 3"], still_root: float) -> bool:
    """Whether the root's own motion (RMS over its points and all frames) exceeds `still_root` spacings."""
    p_root = torch.from_numpy(p_canonical[model.labels == model.root])
    moved = se3.transform(torch.from_numpy(model.Ts_frame_canonical[:, model.root]), p_root)
    travelled = float((moved - p_root).square().sum(-1).mean().sqrt())
    return travelled > still_root * spacing(p_canonical)


class ArticulatedMotion(nn.Module):
    """Forward kinematics of a typed tree with its axes, states and root motion as parameters.

    The canonical frame stays at zero states and an unmoved root. A root that does not move is held at
    the identity; one that does has a free rigid motion in every frame.
    """

    def __init__(self, model: KinematicModel, root_moves: bool) -> None:
        super().__init__()
        self.root = model.root
        self.order = model.joints_from_root()
        self.joints = [(int(model.joint_parent[j]), int(model.joint_child[j])) for j in self.order]
        revolute = np.array([model.joint_types[j] == "revolute" for j in self.order], dtype=bool)
        self.revolute = torch.from_numpy(revolute)
        self.axis = nn.Parameter(torch.from_numpy(model.axis[self.order]))
        self.point = nn.Parameter(torch.from_numpy(model.point[self.order]))
        states = model.states[self.order]
        self.coordinate = nn.Parameter(torch.from_numpy(np.where(revolute[:, None], states[..., 0], states[..., 1])))
        T_frame_root = torch.from_numpy(model.Ts_frame_canonical[:, model.root])
        twist = se3.log(T_frame_root) if root_moves else torch.zeros(len(T_frame_root), 6, dtype=torch.float64)
        self.root_twist = nn.Parameter(twist, requires_grad=root_moves)
        moving = torch.ones(len(T_frame_root), dtype=torch.float64)
        moving[model.canonical_frame] = 0.0
        self.moving = moving

    def states(self) -> Float64[Tensor, "joints frames 2"]:
        """(angle, distance) of each joint, in `order`."""
        coordinate = self.coordinate * self.moving
        zero = torch.zeros_like(coordinate)
        turns = self.revolute[:, None]
        return torch.stack([torch.where(turns, coordinate, zero), torch.where(turns, zero, coordinate)], dim=-1)

    def unit_axis(self) -> Float64[Tensor, "joints 3"]:
        return nn.functional.normalize(self.axis, dim=-1)

    def forward(self) -> Float64[Tensor, "frames parts 4 4"]:
        T_frame_root = se3.exp(self.root_twist * self.moving[:, None])
        return forward_kinematics(T_frame_root, self.joints, self.unit_axis(), self.point, self.states(), self.root)

    @torch.no_grad()
    def to_model(self, model: KinematicModel, energies: dict[str, float]) -> KinematicModel:
        """The model with this chain's axes, states and motions."""
        axis, point, states = model.axis.copy(), model.point.copy(), model.states.copy()
        unit = self.unit_axis()
        axis[self.order] = unit.numpy()
        point[self.order] = nearest_point_to_origin(unit, self.point).numpy()
        states[self.order] = self.states().numpy()
        return model.replace(
            axis=axis,
            point=point,
            states=states,
            Ts_frame_canonical=self().numpy(),
            energies=model.energies | energies,
        )
