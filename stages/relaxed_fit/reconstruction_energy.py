"""E_recons = l_CD E_CD + l_EMD E_EMD + l_flow E_flow (Eq. 5): how well moved points explain the frames.

All three terms are mean Euclidean distances in the normalised frame, so that they weigh alike at any
scale and far outliers pull with bounded force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from torch import Tensor

from schemas.config import EnergyConfig
from schemas.flow import Flow
from schemas.sequence import PointSequence
from stages.flow.trajectories import interpolate
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points, spacing, working_points

FLOW_REACH = 5.0  # predicted points farther than this from any match, in spacings, have no valid flow


@dataclass(frozen=True)
class EnergyTerms:
    """The weighted total and the three plain terms, as scalars in the autograd graph."""

    total: Float[Tensor, ""]
    cd: Float[Tensor, ""]
    emd: Float[Tensor, ""]
    flow: Float[Tensor, ""]

    def row(self) -> list[float]:
        """(E_recons, E_CD, E_EMD, E_flow) as plain numbers."""
        return [float(term.detach()) for term in (self.total, self.cd, self.emd, self.flow)]


class ReconstructionEnergy:
    """E_recons of points of the canonical frame against all other frames.

    Correspondences (nearest neighbours, assignments, interpolated flow) are constants of each step and are
    found anew as often as the configuration says; distances are differentiable.
    """

    def __init__(
        self, sequence: PointSequence, flow: Flow, canonical_frame: int, config: EnergyConfig, points: int, steps: int
    ) -> None:
        """`points` per frame take part; `steps` is the length of the whole run (E_EMD joins in late)."""
        frames = sequence.frames()
        self.config, self.steps = config, steps
        self.others = [t for t in range(len(frames)) if t != canonical_frame]
        self.index = working_points(frames[canonical_frame], points)
        self.p_canonical = frames[canonical_frame][self.index]
        self._targets = [frames[t][working_points(frames[t], points)] for t in self.others]
        self._target_tensors = [torch.from_numpy(target) for target in self._targets]
        self._target_trees = [KDTree(target) for target in self._targets]
        emd_count = max(1, min(len(self.p_canonical), *map(len, self._targets)) // config.emd_downsampling)
        self._emd_points = farthest_points(self.p_canonical, emd_count)
        self._emd_targets = [target[farthest_points(target, emd_count)] for target in self._targets]
        self._flow_reach = FLOW_REACH * spacing(self.p_canonical)
        self._flow_samples = {
            t: (KDTree(frames[t][source]), np.column_stack([motion, confidence]))
            for t, (source, _, motion, confidence) in enumerate(flow.pairs())
            if len(source)
        }
        self._forward: list[Int64[np.ndarray, "points"]] = []
        self._backward: list[Int64[np.ndarray, "targets"]] = []
        self._assignments: list[tuple[np.ndarray, np.ndarray]] = []
        self._flow_targets: list[tuple[Tensor, Tensor]] = []

    def __call__(self, predicted: Float64[Tensor, "frames points 3"], step: int) -> EnergyTerms:
        """The energy of the canonical points `self.index` as predicted in every frame."""
        config = self.config
        points = predicted.detach().numpy()
        if not self._forward or step % config.neighbours_every == 0:
            self._find_neighbours(points)
        late = step >= config.emd_start * self.steps
        if config.lambda_emd and late and (not self._assignments or step % config.emd_every == 0):
            self._assign(points)
        zero = predicted.new_zeros(())
        cd = self._chamfer(predicted)
        emd = self._earth_mover(predicted) if self._assignments else zero
        flow = self._flow(predicted) if config.lambda_flow else zero
        total = config.lambda_cd * cd + config.lambda_emd * emd + config.lambda_flow * flow
        return EnergyTerms(total, cd, emd, flow)

    def _find_neighbours(self, points: Float64[np.ndarray, "frames points 3"]) -> None:
        self._forward, self._backward, self._flow_targets = [], [], []
        for slot, t in enumerate(self.others):
            self._forward.append(nearest(self._target_trees[slot], points[t])[1])
            self._backward.append(nearest(KDTree(points[t]), self._targets[slot])[1])
        for t in range(len(points) - 1):
            if t not in self._flow_samples:
                self._flow_targets.append(
                    (
                        torch.zeros(points[t].shape, dtype=torch.float64),
                        torch.zeros(len(points[t]), dtype=torch.float64),
                    )
                )
                continue
            tree, values = self._flow_samples[t]
            samples, distance = interpolate(tree, values, points[t], self.config.flow_neighbours)
            weight = np.where(distance <= self._flow_reach, samples[:, 3], 0.0)
            self._flow_targets.append((torch.from_numpy(samples[:, :3]), torch.from_numpy(weight)))

    def _assign(self, points: Float64[np.ndarray, "frames points 3"]) -> None:
        self._assignments = [
            linear_sum_assignment(cdist(points[t][self._emd_points], self._emd_targets[slot], "sqeuclidean"))
            for slot, t in enumerate(self.others)
        ]

    def _chamfer(self, predicted: Float64[Tensor, "frames points 3"]) -> Float64[Tensor, ""]:
        """Mean distance to the nearest neighbour, both ways, averaged over frames."""
        terms = []
        for slot, t in enumerate(self.others):
            target = self._target_tensors[slot]
            terms.append(_distance(predicted[t], target[self._forward[slot]]).mean())
            terms.append(_distance(predicted[t][self._backward[slot]], target).mean())
        return torch.stack(terms).sum() / len(self.others)

    def _earth_mover(self, predicted: Float64[Tensor, "frames points 3"]) -> Float64[Tensor, ""]:
        """Mean distance under the best one-to-one assignment of evenly spread points."""
        terms = [
            _distance(predicted[t][self._emd_points[rows]], torch.from_numpy(self._emd_targets[slot][columns])).mean()
            for slot, (t, (rows, columns)) in enumerate(zip(self.others, self._assignments, strict=True))
        ]
        return torch.stack(terms).mean()

    def _flow(self, predicted: Float64[Tensor, "frames points 3"]) -> Float64[Tensor, ""]:
        """Mean difference between predicted and estimated flow, over points whose flow is known."""
        targets = torch.stack([target for target, _ in self._flow_targets])
        weights = torch.stack([weight for _, weight in self._flow_targets])
        difference = _distance(predicted[1:] - predicted[:-1], targets)
        return (weights * difference).sum() / weights.sum().clamp_min(1e-12)


def _distance(a: Float64[Tensor, "*batch 3"], b: Float64[Tensor, "*batch 3"]) -> Float64[Tensor, "*batch"]:
    """Euclidean distance whose gradient is finite at zero."""
    return ((a - b).square().sum(-1) + 1e-12).sqrt()
