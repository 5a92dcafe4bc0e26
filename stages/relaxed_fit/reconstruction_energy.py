"""E_recons = l_CD E_CD + l_EMD E_EMD + l_flow E_flow (Eq. 5): how well moved points explain the frames.

All three terms are mean Euclidean distances in the normalised frame, so that they weigh alike at any
scale and far outliers pull with bounded force. The arithmetic is that of the points given: plain numbers for numpy
arrays, and a graph to descend for torch tensors, which this module need not import.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from schemas.config import EnergyConfig
from schemas.flow import Flow
from schemas.sequence import PointSequence
from stages.flow.trajectories import interpolate
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points, point_spacing, working_points

Array = Any  # a numpy array, or a torch tensor where gradients are wanted

FLOW_REACH = 5.0  # predicted points farther than this from any match, in spacings, have no valid flow


@dataclass(frozen=True)
class EnergyTerms:
    """The weighted total and the three plain terms: numbers, or scalar tensors."""

    total: Array
    cd: Array
    emd: Array
    flow: Array

    def row(self) -> list[float]:
        """(E_recons, E_CD, E_EMD, E_flow) as plain numbers."""
        return [float(_plain(term)) for term in (self.total, self.cd, self.emd, self.flow)]


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
        self._target_trees = [KDTree(target) for target in self._targets]
        emd_count = max(1, min(len(self.p_canonical), *map(len, self._targets)) // config.emd_downsampling)
        self._emd_points = farthest_points(self.p_canonical, emd_count)
        self._emd_targets = [target[farthest_points(target, emd_count)] for target in self._targets]
        self._flow_reach = FLOW_REACH * point_spacing(self.p_canonical)
        pairs = [pair for pair in flow.pairs() if len(pair.source_index)]
        self._flow_sources = [pair.source_frame for pair in pairs]
        self._flow_ends = [pair.target_frame for pair in pairs]
        self._flow_samples = [
            (KDTree(frames[pair.source_frame][pair.source_index]), np.column_stack([pair.flow, pair.confidence]))
            for pair in pairs
        ]
        self._forward: list[Int64[np.ndarray, "points"]] = []
        self._backward: list[Int64[np.ndarray, "targets"]] = []
        self._assignments: list[tuple[np.ndarray, np.ndarray]] = []
        self._flow_targets: list[tuple[np.ndarray, np.ndarray]] = []

    def __call__(self, predicted: Array, step: int) -> EnergyTerms:
        """The energy of the canonical points `self.index` as predicted (frames, points, 3) in every frame."""
        config = self.config
        points = _plain(predicted)
        if not self._forward or step % config.neighbours_every == 0:
            self._find_neighbours(points)
        late = step >= config.emd_start * self.steps
        if config.lambda_emd and late and (not self._assignments or step % config.emd_every == 0):
            self._assign(points)
        cd = self._chamfer(predicted)
        emd = self._earth_mover(predicted) if self._assignments else 0.0 * cd
        flow = self._flow(predicted) if config.lambda_flow else 0.0 * cd
        total = config.lambda_cd * cd + config.lambda_emd * emd + config.lambda_flow * flow
        return EnergyTerms(total, cd, emd, flow)

    def _find_neighbours(self, points: Float64[np.ndarray, "frames points 3"]) -> None:
        self._forward, self._backward, self._flow_targets = [], [], []
        for slot, t in enumerate(self.others):
            self._forward.append(nearest(self._target_trees[slot], points[t])[1])
            self._backward.append(nearest(KDTree(points[t]), self._targets[slot])[1])
        for t, (tree, values) in zip(self._flow_sources, self._flow_samples, strict=True):
            samples, distance = interpolate(tree, values, points[t], self.config.flow_neighbours)
            weight = np.where(distance <= self._flow_reach, samples[:, 3], 0.0)
            self._flow_targets.append((samples[:, :3], weight))

    def _assign(self, points: Float64[np.ndarray, "frames points 3"]) -> None:
        self._assignments = [
            linear_sum_assignment(cdist(points[t][self._emd_points], self._emd_targets[slot], "sqeuclidean"))
            for slot, t in enumerate(self.others)
        ]

    def _chamfer(self, predicted: Array) -> Array:
        """Mean distance to the nearest neighbour, both ways, averaged over frames."""
        total = 0.0
        for slot, t in enumerate(self.others):
            target = _like(predicted, self._targets[slot])
            total = total + _distance(predicted[t], target[self._forward[slot]]).mean()
            total = total + _distance(predicted[t][self._backward[slot]], target).mean()
        return total / len(self.others)

    def _earth_mover(self, predicted: Array) -> Array:
        """Mean distance under the best one-to-one assignment of evenly spread points."""
        total = 0.0
        for slot, (t, (rows, columns)) in enumerate(zip(self.others, self._assignments, strict=True)):
            target = _like(predicted, self._emd_targets[slot][columns])
            total = total + _distance(predicted[t][self._emd_points[rows]], target).mean()
        return total / len(self.others)

    def _flow(self, predicted: Array) -> Array:
        """Mean difference between predicted and estimated flow, over points whose flow is known."""
        if not self._flow_targets:
            return 0.0 * predicted.sum()
        targets = _like(predicted, np.stack([target for target, _ in self._flow_targets]))
        weights = np.stack([weight for _, weight in self._flow_targets])
        difference = _distance(predicted[self._flow_ends] - predicted[self._flow_sources], targets)
        return (_like(predicted, weights) * difference).sum() / max(float(weights.sum()), 1e-12)


def _distance(a: Array, b: Array) -> Array:
    """Euclidean distance whose gradient is finite at zero."""
    return (((a - b) ** 2).sum(-1) + 1e-12) ** 0.5


def _like(array: Array, values: Float64[np.ndarray, "..."]) -> Array:
    """The values as a tensor where `array` is one."""
    return array.new_tensor(values) if hasattr(array, "new_tensor") else values


def _plain(array: Array) -> Any:
    """The array's numbers, cut off from its graph where it has one."""
    return array.detach().numpy() if hasattr(array, "detach") else array
