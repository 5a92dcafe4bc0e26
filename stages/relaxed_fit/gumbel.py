"""Solver `gumbel`: gradient descent on a segmentation field and free motions, as published (A.6)."""

from __future__ import annotations

import math

import numpy as np
import roma
import torch
from jaxtyping import Float64, Int64
from torch import Tensor, nn

from schemas.config import GumbelConfig, RelaxedFitConfig
from schemas.flow import Flow
from schemas.relaxed import RelaxedModel
from schemas.sequence import PointSequence
from stages.flow.trajectories import follow_flow
from stages.kernels.motion.rigid_motion import move_points
from stages.relaxed_fit.reconstruction_energy import ReconstructionEnergy
from stages.relaxed_fit.start import Start, start_from_flow
from stages.support.progress import Progress

FIELD_WARM_UP = 500  # gradient steps that teach the segmentation field the start's labels
HISTORY_EVERY = 10


class SegmentationField(nn.Module):
    """f(x): logits of the parts at a canonical point; a perceptron 3 - hidden - parts."""

    def __init__(self, hidden: int, parts: int, generator: torch.Generator) -> None:
        super().__init__()
        self.input = nn.Linear(3, hidden, dtype=torch.float64)
        self.output = nn.Linear(hidden, parts, dtype=torch.float64)
        for layer in (self.input, self.output):
            bound = 1 / math.sqrt(layer.in_features)
            nn.init.uniform_(layer.weight, -bound, bound, generator=generator)
            nn.init.uniform_(layer.bias, -bound, bound, generator=generator)

    def forward(self, p: Float64[Tensor, "points 3"]) -> Float64[Tensor, "points parts"]:
        return self.output(torch.relu(self.input(p)))


class FreeMotions(nn.Module):
    """One rigid motion per frame and part: a 6D rotation about the part's pivot and a translation.

    The canonical frame's own motion is the identity and stays it.
    """

    def __init__(self, start: Start, p_points: Float64[np.ndarray, "points 3"], canonical_frame: int) -> None:
        super().__init__()
        Ts = torch.from_numpy(start.Ts_frame_canonical)
        parts = Ts.shape[1]
        pivots = np.zeros((parts, 3))
        for part in np.unique(start.labels):
            pivots[part] = p_points[start.labels == part].mean(axis=0)
        self.canonical_frame = canonical_frame
        self.pivots = torch.from_numpy(pivots)
        self.rotation = nn.Parameter(Ts[..., :3, :2].clone())
        self.translation = nn.Parameter(torch.from_numpy(move_points(start.Ts_frame_canonical, pivots) - pivots))

    def forward(self) -> Float64[Tensor, "frames parts 4 4"]:
        R = roma.special_gramschmidt(self.rotation)
        turned = (R @ self.pivots[..., None]).squeeze(-1)
        moved = (self.pivots + self.translation - turned).unsqueeze(-1)
        bottom = moved.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(*R.shape[:-2], 1, 4)
        Ts = torch.cat([torch.cat([R, moved], dim=-1), bottom], dim=-2)
        identity = torch.eye(4, dtype=Ts.dtype).expand(1, *Ts.shape[1:])
        return torch.cat([Ts[: self.canonical_frame], identity, Ts[self.canonical_frame + 1 :]])


def solve_gumbel(
    sequence: PointSequence,
    flow: Flow,
    canonical_frame: int,
    config: RelaxedFitConfig,
    rng: np.random.Generator,
    progress: Progress,
) -> RelaxedModel:
    """Minimise E_recons over labels and motions by Adam with straight-through Gumbel-softmax labels."""
    settings = config.gumbel
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    energy = ReconstructionEnergy(sequence, flow, canonical_frame, config.energy, settings.points, settings.iterations)
    start = _start(energy.p_canonical, sequence, flow, canonical_frame, config)
    parts = start.Ts_frame_canonical.shape[1]
    p_canonical = torch.from_numpy(energy.p_canonical)
    field = SegmentationField(settings.hidden, parts, generator)
    if settings.start == "flow":
        _teach(field, p_canonical, torch.from_numpy(start.labels))
    motions = FreeMotions(start, energy.p_canonical, canonical_frame)
    optimizer = torch.optim.Adam(
        [
            {"params": field.parameters(), "lr": settings.learning_rate_labels},
            {"params": motions.parameters(), "lr": settings.learning_rate_motion},
        ]
    )
    scheduler = torch.optim.lr_scheduler.LambdaLR(
        optimizer, lambda step: _cosine(1.0, settings.learning_rate_end, step / settings.iterations)
    )
    history = []
    for step in range(settings.iterations):
        temperature = _cosine(settings.temperature_start, settings.temperature_end, step / settings.iterations)
        one_hot = _straight_through_labels(field(p_canonical), temperature, generator)
        terms = energy(_blend(one_hot, motions(), p_canonical), step)
        optimizer.zero_grad()
        terms.total.backward()
        optimizer.step()
        scheduler.step()
        if step % HISTORY_EVERY == 0 or step == settings.iterations - 1:
            history.append(terms.row())
            progress(step + 1, settings.iterations, history[-1][0])
    p_all = torch.from_numpy(sequence.frames()[canonical_frame])
    with torch.no_grad():
        labels = field(p_all).argmax(dim=1).numpy()
        Ts = motions().numpy()
    used, labels = np.unique(labels, return_inverse=True)
    return RelaxedModel(
        canonical_frame=canonical_frame,
        labels=labels.astype(np.int64),
        Ts_frame_canonical=np.ascontiguousarray(Ts[:, used]),
        energy_history=np.array(history),
        solver="gumbel",
        iterations=settings.iterations,
    )


def _start(
    p_canonical: Float64[np.ndarray, "points 3"],
    sequence: PointSequence,
    flow: Flow,
    canonical_frame: int,
    config: RelaxedFitConfig,
) -> Start:
    settings: GumbelConfig = config.gumbel
    if settings.start == "flow":
        trajectories = follow_flow(p_canonical, sequence, flow, canonical_frame, config.energy.flow_neighbours)
        return start_from_flow(p_canonical, trajectories, settings.max_parts)
    still = np.tile(np.eye(4), (sequence.frame_count, settings.max_parts, 1, 1))
    return Start(np.empty(0, dtype=np.int64), still)


def _teach(field: SegmentationField, p_points: Float64[Tensor, "points 3"], labels: Int64[Tensor, "points"]) -> None:
    """Fit the field to given labels by cross-entropy."""
    optimizer = torch.optim.Adam(field.parameters(), lr=1e-2)
    for _ in range(FIELD_WARM_UP):
        loss = nn.functional.cross_entropy(field(p_points), labels)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()


def _straight_through_labels(
    logits: Float64[Tensor, "points parts"], temperature: float, generator: torch.Generator
) -> Float64[Tensor, "points parts"]:
    """Hard one-hot samples of the Gumbel-softmax whose gradient is the soft sample's."""
    uniform = torch.rand(logits.shape, dtype=logits.dtype, generator=generator).clamp(1e-12, 1 - 1e-12)
    soft = torch.softmax((logits - torch.log(-torch.log(uniform))) / temperature, dim=1)
    hard = nn.functional.one_hot(soft.argmax(dim=1), logits.shape[1]).to(soft.dtype)
    return hard - soft.detach() + soft


def _blend(
    one_hot: Float64[Tensor, "points parts"],
    Ts: Float64[Tensor, "frames parts 4 4"],
    p_points: Float64[Tensor, "points 3"],
) -> Float64[Tensor, "frames points 3"]:
    """Every point moved by its part: sum over parts of y_k T_k x (Eq. 1)."""
    T_points = torch.einsum("nk,tkij->tnij", one_hot, Ts[..., :3, :])
    return torch.einsum("tnij,nj->tni", T_points[..., :3], p_points) + T_points[..., 3]


def _cosine(start: float, end: float, share: float) -> float:
    """Cosine annealing from start to end as share goes from 0 to 1."""
    return end + 0.5 * (start - end) * (1 + math.cos(math.pi * min(share, 1.0)))
