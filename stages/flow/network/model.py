"""The feature network (A.1): PointNet++ with multi-scale grouping and 64 features for each point.

It has two levels of set abstraction (512 and 128 centres, each with several neighbourhoods), a global one, and feature
propagation back to every point. Layers on neighbours' features are applied before the features are gathered. That
gives the same result and is much faster.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Float32, Int64
from torch import Tensor, nn

from stages.flow.network.geometry import CENTRE_GROUPS, CENTRES, FINE_GROUPS, HUBS, INVARIANTS, CloudGeometry

FEATURES = 64
RELATION = 7  # numbers that relate a neighbour to its centre
FINE_WIDTHS = (48, 48, 96)
HUB_WIDTHS = (128, 128, 192)
GLOBAL_WIDTHS = (256, 512)
FINE_SCALE, HUB_SCALE = 10.0, 4.0  # scale the offsets of the two levels to about one


@dataclass(frozen=True)
class Clouds:
    """A batch of clouds: the fields of `CloudGeometry` as tensors, with a batch axis first."""

    points: Float32[Tensor, "batch fine 3"]
    normals: Float32[Tensor, "batch fine 3"]
    invariants: Float32[Tensor, "batch fine invariants"]
    groups: tuple[Int64[Tensor, "batch centres k"], ...]
    hub_groups: tuple[Int64[Tensor, "batch hubs k"], ...]
    to_centres: tuple[Int64[Tensor, "batch centres 3"], Float32[Tensor, "batch centres 3"]]
    to_queries: tuple[Int64[Tensor, "batch queries 3"], Float32[Tensor, "batch queries 3"]]
    queries: Float32[Tensor, "batch queries 3"]
    query_invariants: Float32[Tensor, "batch queries invariants"]

    @classmethod
    def of(cls, geometries: Sequence[CloudGeometry], device: torch.device | str = "cpu") -> Self:
        """Batch clouds with the same number of queries."""

        def stacked(name: str) -> Any:
            values = [getattr(geometry, name) for geometry in geometries]
            if isinstance(values[0], tuple):
                return tuple(torch.from_numpy(np.stack(column)).to(device) for column in zip(*values, strict=True))
            return torch.from_numpy(np.stack(values)).to(device)

        return cls(**{name: stacked(name) for name in cls.__dataclass_fields__})


class FeatureNetwork(nn.Module):
    """f(P): a feature for each query point of each cloud. Training makes features of matching points similar."""

    def __init__(self) -> None:
        super().__init__()
        self.fine = nn.ModuleList(Abstraction(INVARIANTS, FINE_WIDTHS) for _ in FINE_GROUPS)
        centre = FINE_WIDTHS[-1] * len(FINE_GROUPS)
        self.hubs = nn.ModuleList(Abstraction(centre, HUB_WIDTHS) for _ in CENTRE_GROUPS)
        hub = HUB_WIDTHS[-1] * len(CENTRE_GROUPS)
        self.whole = perceptron(hub + 3, *GLOBAL_WIDTHS)
        self.to_hubs = perceptron(hub + 3 + GLOBAL_WIDTHS[-1], 256, 256)
        self.to_centres = perceptron(256 + centre, 256, 128)
        self.to_queries = perceptron(128 + INVARIANTS + 3, 128, 128)
        self.head = nn.Linear(128, FEATURES)

    def forward(self, clouds: Clouds) -> Float32[Tensor, "batch queries features"]:
        p_centres, p_hubs = clouds.points[:, :CENTRES], clouds.points[:, :HUBS]
        at_centres = torch.cat(
            [
                level(clouds.invariants, relation(clouds.points, clouds.normals, group, FINE_SCALE), group)
                for level, group in zip(self.fine, clouds.groups, strict=True)
            ],
            dim=-1,
        )
        normals = clouds.normals[:, :CENTRES]
        at_hubs = torch.cat(
            [
                level(at_centres, relation(p_centres, normals, group, HUB_SCALE), group)
                for level, group in zip(self.hubs, clouds.hub_groups, strict=True)
            ]
            + [p_hubs],
            dim=-1,
        )
        whole = self.whole(at_hubs).amax(dim=1, keepdim=True).expand(-1, HUBS, -1)
        at_hubs = self.to_hubs(torch.cat([at_hubs, whole], dim=-1))
        at_centres = self.to_centres(torch.cat([interpolate(at_hubs, *clouds.to_centres), at_centres], dim=-1))
        at_queries = interpolate(at_centres, *clouds.to_queries)
        return self.head(self.to_queries(torch.cat([at_queries, clouds.query_invariants, clouds.queries], dim=-1)))


class Abstraction(nn.Module):
    """The perceptron of one neighbourhood, followed by the maximum of each output over the neighbours."""

    def __init__(self, inputs: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.of_neighbour = nn.Linear(inputs, widths[0], bias=False)
        self.of_relation = nn.Linear(RELATION, widths[0], bias=False)
        self.norm = Norm(widths[0])
        self.rest = perceptron(*widths)

    def forward(
        self,
        features: Float32[Tensor, "batch points c"],
        relations: Float32[Tensor, "batch centres k 7"],
        group: Int64[Tensor, "batch centres k"],
    ) -> Float32[Tensor, "batch centres out"]:
        gathered = gather(self.of_neighbour(features), group)
        return self.rest(torch.relu(self.norm(gathered + self.of_relation(relations)))).amax(dim=2)


class Norm(nn.BatchNorm1d):
    """Batch normalisation of the last axis, for any number of axes before it."""

    def forward(self, input: Tensor) -> Tensor:
        return super().forward(input.reshape(-1, input.shape[-1])).reshape(input.shape)


def perceptron(*widths: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for before, after in pairwise(widths):
        layers += [nn.Linear(before, after, bias=False), Norm(after), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)


def gather(values: Tensor, index: Int64[Tensor, "batch centres k"]) -> Tensor:
    """Gather values (batch, points, c) at `index` to (batch, centres, k, c)."""
    batch, points, channels = values.shape
    offsets = (torch.arange(batch, device=index.device) * points).view(-1, 1, 1)
    return values.reshape(-1, channels).index_select(0, (index + offsets).reshape(-1)).view(*index.shape, channels)


def relation(
    points: Float32[Tensor, "batch points 3"],
    normals: Float32[Tensor, "batch points 3"],
    group: Int64[Tensor, "batch centres k"],
    scale: float,
) -> Float32[Tensor, "batch centres k 7"]:
    """The neighbours' positions relative to their centres: offset, length, and three rotation-invariant angles."""
    centres = group.shape[1]
    offset = (gather(points, group) - points[:, :centres, None]) * scale
    length = offset.norm(dim=-1, keepdim=True)
    direction = offset / (length + 1e-6)
    own, theirs = normals[:, :centres, None], gather(normals, group)
    angles = [(a * b).sum(-1, keepdim=True).abs() for a, b in ((own, direction), (theirs, direction), (own, theirs))]
    return torch.cat([offset, length, *angles], dim=-1)


def interpolate(values: Tensor, index: Tensor, weights: Tensor) -> Tensor:
    """Interpolate values (batch, points, c) by weighted means to (batch, queries, c)."""
    return (gather(values, index) * weights.unsqueeze(-1)).sum(dim=2)
