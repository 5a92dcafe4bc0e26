"""A source cloud and its target clouds, and what some rigid bodies explain of them. Lengths are in spacings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64, Int64

from stages.kernels.alignment.fit_cost import fit_costs, refine_motions
from stages.kernels.alignment.oriented_cloud import OrientedCloud
from stages.kernels.labelling.graph_cut import expansion_move
from stages.kernels.points.nearest import SURFACE_NEIGHBOURS, neighbours
from stages.kernels.points.sampling import farthest_points
from stages.kernels.surfaces.surface_graph import SurfaceGraph, smoothness_weights, surface_graph

Motions = Float64[np.ndarray, "bodies targets 4 4"]

BOUNDARY_PRICE = 0.25  # of a surface edge between two bodies, where the surface bends as usual
BODY_PRICE = 12.0
FORTH_WEIGHT, BACK_WEIGHT = 0.5, 1.0  # of the costs of the source's points and of the targets'
REFINED_POINTS = 400
FEWEST_POINTS = 8  # of a body whose motion can be refined


@dataclass(frozen=True)
class Scene:
    """What stays the same while bodies are found. Targets keep all of their points, the source may be thinned."""

    source: OrientedCloud
    targets: Sequence[OrientedCloud]
    graph: SurfaceGraph
    prices: Float64[np.ndarray, "edges"]
    around: Int64[np.ndarray, "points around"]

    @classmethod
    def of(cls, source: OrientedCloud, targets: Sequence[OrientedCloud]) -> Scene:
        graph = surface_graph(source.p)
        own = np.arange(len(source.p))[:, None]
        around = np.concatenate([own, neighbours(source.p, SURFACE_NEIGHBOURS)[1]], axis=1)
        return cls(source, targets, graph, BOUNDARY_PRICE * smoothness_weights(source.p, graph), around)

    def costs(self, Ts: Float64[np.ndarray, "targets 4 4"]) -> Float64[np.ndarray, "targets points"]:
        """The cost of each source point in each target if it moved by `Ts`."""
        return np.stack(
            [fit_costs(target, self.source, T[None])[0][0] for target, T in zip(self.targets, Ts, strict=True)]
        )

    def costs_back(
        self,
        labels: Int64[np.ndarray, "points"],
        Ts: Motions,
        kept: Bool[np.ndarray, "points"] | slice = slice(None),
    ) -> list[Float64[np.ndarray, "target_points"]]:
        """The cost of each target point, given where the source's points that are kept have moved."""
        chosen = np.flatnonzero(kept) if isinstance(kept, np.ndarray) else np.arange(len(labels))
        if len(chosen) == 0:
            return [np.ones(len(target.p)) for target in self.targets]
        source, still = self.source.take(chosen), np.eye(4)[None]
        return [
            fit_costs(source.moved(Ts[labels[chosen], t]), target, still)[0][0] for t, target in enumerate(self.targets)
        ]

    def refined(
        self,
        index: Int64[np.ndarray, "body"],
        Ts: Float64[np.ndarray, "targets 4 4"],
        reaches: Sequence[float],
        target_weights: Sequence[Float64[np.ndarray, "target_points"]] | None = None,
    ) -> Float64[np.ndarray, "targets 4 4"]:
        """The motion of a body refined in each target."""
        body = self.source.take(index[farthest_points(self.source.p[index], REFINED_POINTS)])
        weights = [None] * len(self.targets) if target_weights is None else list(target_weights)
        return np.stack(
            [refine_motions(target, body, Ts[t][None], reaches, weights[t])[0] for t, target in enumerate(self.targets)]
        )


@dataclass(frozen=True)
class Explanation:
    """Rigid bodies with a motion in each target, and the body of each source point.

    `penalty` is what the joints between the bodies add to the energy.
    """

    scene: Scene
    labels: Int64[np.ndarray, "points"]
    Ts: Motions
    costs: Float64[np.ndarray, "bodies targets points"]
    penalty: float = 0.0

    @classmethod
    def by_one_body(cls, scene: Scene, Ts: Float64[np.ndarray, "targets 4 4"]) -> Explanation:
        labels = np.zeros(len(scene.source.p), dtype=np.int64)
        return cls(scene, labels, Ts[None], scene.costs(Ts)[None])

    @property
    def own_costs(self) -> Float64[np.ndarray, "targets points"]:
        """The costs of the points under their own bodies' motions."""
        return self.costs[self.labels, :, np.arange(len(self.labels))].T

    @cached_property
    def energy(self) -> float:
        """What the bodies leave of the source and of the targets, and the prices of boundaries and bodies."""
        scene, points = self.scene, len(self.labels)
        a, b = scene.graph.edges.T
        boundary = scene.prices[self.labels[a] != self.labels[b]].sum()
        back = np.mean([costs.mean() for costs in scene.costs_back(self.labels, self.Ts)])
        forth = self.own_costs.mean(axis=0).sum()
        return float(
            FORTH_WEIGHT * forth + BACK_WEIGHT * points * back + boundary + BODY_PRICE * len(self.Ts) + self.penalty
        )

    def relabelled(
        self, order: Sequence[int], bonus: Float64[np.ndarray, "bodies points"] | None = None
    ) -> Explanation:
        """Each point with the body that suits it and its surroundings, by one expansion move for each of `order`.

        `bonus` is taken off the points' costs.
        """
        unary = self.costs.mean(axis=1) - (0.0 if bonus is None else bonus)
        labels = self.labels
        for body in order:
            free = np.flatnonzero(labels != body)
            if len(free) == 0:
                continue
            switches, gain = expansion_move(
                labels, body, free, unary[labels[free], free], unary[body, free], self.scene.graph.edges,
                self.scene.prices,
            )  # fmt: skip
            if gain > 0:
                labels = labels.copy()
                labels[free[switches]] = body
        return Explanation(self.scene, labels, self.Ts, self.costs, self.penalty)

    def with_motion(self, body: int, Ts: Float64[np.ndarray, "targets 4 4"]) -> Explanation:
        """One body moved otherwise, or a further one where there is none of that number."""
        kept = [k for k in range(len(self.Ts)) if k != body]
        new = self.scene.costs(Ts)
        motions, costs = np.insert(self.Ts[kept], body, Ts, axis=0), np.insert(self.costs[kept], body, new, axis=0)
        return Explanation(self.scene, self.labels, motions, costs, self.penalty)

    def polished(self, rounds: int, reaches: Sequence[float]) -> Explanation:
        """Motions and labels improved in turn."""
        polished = self
        for _ in range(rounds):
            for body in range(len(polished.Ts)):
                index = np.flatnonzero(polished.labels == body)
                if len(index) >= FEWEST_POINTS:
                    Ts = polished.scene.refined(index, polished.Ts[body], reaches)
                    polished = polished.with_motion(body, Ts)
            polished = polished.relabelled(range(len(polished.Ts)))
        return polished
