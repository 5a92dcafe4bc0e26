"""Labels by minimum cuts on the clouds of several frames together, each carried to the canonical frame.

Fused clouds show creases and gaps that one frame's sampling hides, and every point brings its own evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from stages.final_fit.working import Fit, Frames
from stages.kernels.alignment.evidence import gross_cost, motion_cost
from stages.kernels.labelling.graph_cut import expansion_move
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import SURFACE_NEIGHBOURS, KDTree, nearest
from stages.kernels.surfaces.surface_graph import smoothness_weights, surface_graph

FIRST_LOOK = 3  # frames in which a part is seen to be out of the question
RULED_OUT = 4.0  # a part whose motion suits a point so much worse than the best one's is not asked
BONUSES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 3.0, 4.0)


@dataclass(frozen=True)
class LabelProblem:
    """Costs of every fused point with each part it may belong to (infinite elsewhere), and prices of its edges."""

    costs: Float64[np.ndarray, "points parts"]
    edges: Int64[np.ndarray, "edges 2"]
    prices: Float64[np.ndarray, "edges"]

    def expand(self, labels: Int64[np.ndarray, "points"], part: int, bonus: float = 0.0) -> Int64[np.ndarray, "points"]:
        """The best labelling in which some points have switched to `part`, each of which is paid `bonus`."""
        nodes = np.flatnonzero(np.isfinite(self.costs[:, part]) & (labels != part))
        if len(nodes) == 0:
            return labels
        stay, switch = self.costs[nodes, labels[nodes]], self.costs[nodes, part] - bonus
        switches, gain = expansion_move(labels, part, nodes, stay, switch, self.edges, self.prices)
        if gain <= 0:
            return labels
        labels = labels.copy()
        labels[nodes[switches]] = part
        return labels

    def grow(self, labels: Int64[np.ndarray, "points"], part: int, least: float) -> Int64[np.ndarray, "points"]:
        """Where a part has fewer than `least` points, it gets those nearest to being its own."""
        if np.count_nonzero(labels == part) >= least:
            return labels
        for bonus in BONUSES:
            grown = self.expand(labels, part, bonus)
            if np.count_nonzero(grown == part) >= least:
                return grown
        dearness = self._dearness(labels, part)
        cheapest = np.argsort(dearness, kind="stable")[: int(np.ceil(least))]
        grown = labels.copy()
        grown[cheapest[np.isfinite(dearness[cheapest])]] = part
        return grown

    def with_every_part(self, labels: Int64[np.ndarray, "points"], count: int) -> Int64[np.ndarray, "count"]:
        """The labels of the first `count` points, each part of the tree having at least one of them.

        A part that has none gets the point that costs least, if need be one that may not be its own; never another
        part's only one.
        """
        labels = labels.copy()
        for part in np.setdiff1d(np.arange(self.costs.shape[1]), labels[:count]):
            spare = np.flatnonzero(np.bincount(labels[:count])[labels[:count]] > 1)
            labels[spare[self._dearness(labels, part)[spare].argmin()]] = part
        return labels[:count]

    def _dearness(self, labels: Int64[np.ndarray, "points"], part: int) -> Float64[np.ndarray, "points"]:
        """What it costs each point to be of that part; infinite where it may not."""
        may = np.isfinite(self.costs[:, part])
        dearness = np.full(len(labels), np.inf)
        dearness[may] = self.costs[may, part] - self.costs[may, labels[may]]
        return dearness


def relabel(fit: Fit, frames: Frames, fused_frames: int, boundary_price: float, min_share: float) -> Fit:
    """Every point with its own part or one that touches or is linked to it; no part is left without points.

    A part that is part of the tree holds at least `min_share` of the points: where cuts leave it fewer, because its
    neighbours' motions explain its points as well, it gets those which that costs least.
    """
    p, labels = fuse(fit, frames, fused_frames)
    problem = label_problem(fit, frames, p, labels, boundary_price)
    least = min_share * len(p)
    for unseen in np.setdiff1d(np.arange(fit.chain.parts), labels):
        labels = problem.grow(labels, int(unseen), least)
    for part_ in range(fit.chain.parts):
        labels = problem.expand(labels, part_)
    for _ in range(3):  # what one part is given, another may have lost
        for part_ in range(fit.chain.parts):
            labels = problem.grow(labels, part_, least)
    return Fit(fit.chain, problem.with_every_part(labels, len(frames.p)))


def label_problem(
    fit: Fit,
    frames: Frames,
    p: Float64[np.ndarray, "points 3"],
    labels: Int64[np.ndarray, "points"],
    boundary_price: float,
) -> LabelProblem:
    """What points of the canonical frame cost with the parts that each may belong to, and the prices of their edges."""
    Ts = fit.chain.Ts
    graph = surface_graph(p, SURFACE_NEIGHBOURS)
    may = _candidates(fit, labels, graph.crossings(labels)[0])[labels]
    looked_at = list(_spread(frames, FIRST_LOOK))

    def gross(point: np.ndarray, part: np.ndarray) -> np.ndarray:
        return gross_cost(frames.registration, p, point, part, Ts, looked_at)

    def exact(point: np.ndarray, part: np.ndarray) -> np.ndarray:
        return motion_cost(frames.registration, p, point, part, Ts)

    costs = _among(np.isfinite(_among(may, labels, gross)), labels, exact)
    return LabelProblem(costs, graph.edges, boundary_price * smoothness_weights(p, graph))


def _among(
    may: Bool[np.ndarray, "points parts"],
    labels: Int64[np.ndarray, "points"],
    cost: Callable[[Int64[np.ndarray, "entries"], Int64[np.ndarray, "entries"]], Float64[np.ndarray, "entries"]],
) -> Float64[np.ndarray, "points parts"]:
    """What each point costs with the parts that it may belong to; infinite where it may not, or where another part
    suits it so much better that this one is ruled out. Its own part never is."""
    costs = np.full(may.shape, np.inf)
    point, part = np.nonzero(may)
    costs[point, part] = cost(point, part)
    ruled_out = costs > costs.min(axis=1, keepdims=True) + RULED_OUT
    ruled_out[np.arange(len(labels)), labels] = False
    costs[ruled_out] = np.inf
    return costs


def fuse(fit: Fit, frames: Frames, count: int) -> tuple[Float64[np.ndarray, "fused 3"], Int64[np.ndarray, "fused"]]:
    """Canonical points and labels, then those of `count - 1` other frames, moved back by the part that each lies on."""
    Ts = fit.chain.Ts
    inverse = np.linalg.inv(Ts)
    clouds, labels = [frames.p], [fit.labels]
    for t in _spread(frames, count - 1):
        posed = move_points(Ts[t, fit.labels], frames.p)
        here = fit.labels[nearest(KDTree(posed), frames.registration.frames[t])[1]]
        clouds.append(move_points(inverse[t, here], frames.registration.frames[t]))
        labels.append(here)
    return np.concatenate(clouds), np.concatenate(labels)


def _spread(frames: Frames, count: int) -> Iterable[int]:
    """`count` frames besides the canonical one, from the farthest in time on, evenly spread."""
    others = sorted(frames.registration.others, key=lambda t: -abs(t - frames.canonical_frame))
    places = np.linspace(0, len(others) - 1, min(count, len(others))).round().astype(int)
    return [others[place] for place in np.unique(places)]


def _candidates(fit: Fit, labels: Int64[np.ndarray, "points"], touching: Int64[np.ndarray, "pairs 2"]) -> np.ndarray:
    """Which parts (columns) a point of each part (rows) may go to: those that touch it, or that a joint or one
    unseen link joins to it."""
    may = np.eye(fit.chain.parts, dtype=bool)
    pairs = [touching, np.stack([fit.chain.tree.parent, fit.chain.tree.child], axis=1)]
    seen = np.isin(np.arange(fit.chain.parts), labels)
    parents = fit.chain.tree.parents
    for link in np.flatnonzero(~seen):
        around = [*np.flatnonzero(parents == link), *parents[[link]][parents[[link]] >= 0]]
        pairs.append(np.array([(a, b) for a in around for b in around], dtype=np.int64).reshape(-1, 2))
    a, b = np.concatenate(pairs).T
    may[a, b] = may[b, a] = True
    return may
