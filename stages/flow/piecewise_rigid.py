"""Piecewise rigid motion of a surface, from matches of which most may be wrong.

Articulated objects move in rigid pieces. Triples of nearby matches that keep their distances suggest rigid motions.
Those that explain the matches around are improved by registering the surface around to the target. Then minimum cuts
assign one motion to every node. It should bring the node's neighbourhood onto the target, agree with its matches, and
keep it in contact with its neighbours on the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.alignment.registration import group_means, normal_equations, robust_weight, turn_about
from stages.kernels.labelling.graph_cut import best_switches
from stages.kernels.motion.rigid_motion import best_motion, move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points, normals

# Lengths are in units of the clouds' spacing.
SEEDS = 64  # places around which motions are suggested
PATCH_MATCHES = 80  # matches nearest to a seed, from which triples are drawn
PATCH_POINTS = 60  # points nearest to a seed, which are registered
TRIPLES, SCREENED = 400, 40  # triples drawn around each seed, and those tried of them, which keep distances
KEPT = 4  # distinct motions kept for each seed
LENGTH_CHANGE, LEAST_SIDE = 4.0, 3.0  # largest change and smallest length of a triple's distances
MATCH_REACH = 4.0  # a motion explains a match within this distance
SURFACE_REACH = 3.0  # the cost of a distance from the target is constant beyond this
TOUCH_REACH = 12.0  # the cost of a gap between neighbours is constant beyond this
REFINEMENTS = 5  # registration steps of a motion
DISTINCT = 2.5  # motions that differ by less on a patch count as the same
MOST_MOTIONS = 60
MATCH_WEIGHT, TOUCH_WEIGHT = 0.5, 0.12  # of unexplained matches and of gaps at edges, relative to a node off the target
ROUNDS = 2  # rounds of labelling and registering


@dataclass(frozen=True)
class Surface:
    """A cloud and its normals (of arbitrary sign)."""

    p: Float64[np.ndarray, "points 3"]
    normals: Float64[np.ndarray, "points 3"]

    @classmethod
    def of(cls, p: Float64[np.ndarray, "points 3"]) -> Surface:
        return cls(p, normals(p))

    @cached_property
    def tree(self) -> KDTree:
        return KDTree(self.p)


@dataclass(frozen=True)
class Nodes:
    """The nodes to move, their edges (each pair of neighbours once), and the node that each source point follows."""

    p: Float64[np.ndarray, "nodes 3"]
    edges: Int64[np.ndarray, "edges 2"]
    of_point: Int64[np.ndarray, "points"]


def piecewise_rigid(
    nodes: Nodes,
    source: Surface,
    target: Surface,
    p_from: Float64[np.ndarray, "matches 3"],
    p_to: Float64[np.ndarray, "matches 3"],
    spacing: float,
    rng: np.random.Generator,
) -> Float64[np.ndarray, "nodes 4 4"]:
    """The motion of each node from the source to the target cloud: the identity, or one that matches suggest.

    Matches link points `p_from` near the source to `p_to` near the target. `spacing` is the clouds' spacing.
    """
    seeds = source.p[farthest_points(source.p, SEEDS)]
    suggested, seed = suggested_motions(seeds, p_from, p_to, spacing, rng)
    Ts = np.concatenate([np.eye(4)[None], _distinct(suggested, seed, seeds, source, target, spacing)])
    labels = np.zeros(len(nodes.p), dtype=np.int64)
    for _ in range(ROUNDS):
        costs = _surface_costs(nodes, source, target, Ts, spacing)
        costs += MATCH_WEIGHT * _match_costs(nodes, p_from, p_to, Ts, spacing)
        labels = _label(costs, move_points(Ts[:, None], nodes.p[nodes.edges].mean(axis=1)) / spacing, nodes.edges)
        used, labels = np.unique(labels, return_inverse=True)
        own = labels[nodes.of_point]
        refined = _registered(Ts[used], [source.p[own == k] for k in range(len(used))], target, spacing)
        unused = np.setdiff1d(np.arange(len(Ts)), used)
        Ts = np.concatenate([refined, Ts[unused]])
    return Ts[labels]


def suggested_motions(
    seeds: Float64[np.ndarray, "seeds 3"],
    p_from: Float64[np.ndarray, "matches 3"],
    p_to: Float64[np.ndarray, "matches 3"],
    spacing: float,
    rng: np.random.Generator,
) -> tuple[Float64[np.ndarray, "motions 4 4"], Int64[np.ndarray, "motions"]]:
    """Suggest motions that explain many matches around a seed, from triples that keep their distances.

    Returns the motions and the index of each one's seed.
    """
    count = min(PATCH_MATCHES, len(p_from))
    if count < 3:
        return np.zeros((0, 4, 4)), np.zeros(0, dtype=np.int64)
    patch = KDTree(p_from).query(np.ascontiguousarray(seeds), k=count)[1].astype(np.int64)
    a, b = p_from[patch], p_to[patch]
    triple = rng.integers(count, size=(len(seeds), TRIPLES, 3))
    row = np.arange(len(seeds))[:, None, None]
    corners, images = a[row, triple], b[row, triple]
    sides, image_sides = _sides(corners), _sides(images)
    rigid = (np.abs(sides - image_sides) < LENGTH_CHANGE * spacing) & (sides > LEAST_SIDE * spacing)
    chosen = np.argsort(~rigid.all(axis=-1), axis=1, kind="stable")[:, :SCREENED]
    valid = np.take_along_axis(rigid.all(axis=-1), chosen, axis=1)
    Ts = best_motion(corners[row[..., 0], chosen], images[row[..., 0], chosen])
    moved = move_points(Ts[:, :, None], a[:, None])
    off = np.linalg.norm(moved - b[:, None], axis=-1) / spacing
    score = np.where(valid, (1 - np.minimum(off / MATCH_REACH, 1)).sum(axis=-1), -1.0)
    kept_motions, kept_seeds = [], []
    for _ in range(KEPT):
        best = score.argmax(axis=1)
        found = np.flatnonzero(score[np.arange(len(seeds)), best] > 0)
        kept_motions.append(Ts[found, best[found]])
        kept_seeds.append(found)
        gap = np.linalg.norm(moved - moved[np.arange(len(seeds)), best][:, None], axis=-1).mean(axis=-1)
        score[gap < DISTINCT * spacing] = -1.0
    return np.concatenate(kept_motions), np.concatenate(kept_seeds)


def _sides(corners: Float64[np.ndarray, "*batch 3 3"]) -> Float64[np.ndarray, "*batch 3"]:
    return np.linalg.norm(corners - np.roll(corners, 1, axis=-2), axis=-1)


def _distinct(
    Ts: Float64[np.ndarray, "motions 4 4"],
    seed: Int64[np.ndarray, "motions"],
    seeds: Float64[np.ndarray, "seeds 3"],
    source: Surface,
    target: Surface,
    spacing: float,
) -> Float64[np.ndarray, "distinct 4 4"]:
    """Register motions on the surface around their seeds. Return distinct ones, the best fit first."""
    if len(Ts) == 0:
        return Ts
    count = min(PATCH_POINTS, len(source.p))
    patches = source.p[source.tree.query(np.ascontiguousarray(seeds), k=count)[1].astype(np.int64)][seed]
    Ts = _registered(Ts, list(patches), target, spacing)
    moved = move_points(Ts[:, None], patches)
    distance = nearest(target.tree, moved.reshape(-1, 3))[0].reshape(len(Ts), count) / spacing
    kept: list[int] = []
    for k in np.argsort(np.minimum(distance / SURFACE_REACH, 1).mean(axis=1), kind="stable").tolist():
        gap = np.linalg.norm(move_points(Ts[kept][:, None], patches[k]) - moved[k], axis=-1).mean(axis=-1)
        if (gap > DISTINCT * spacing).all():
            kept.append(k)
        if len(kept) == MOST_MOTIONS:
            break
    return Ts[kept]


def _registered(
    Ts: Float64[np.ndarray, "motions 4 4"],
    pieces: list[Float64[np.ndarray, "points 3"]],
    target: Surface,
    spacing: float,
) -> Float64[np.ndarray, "motions 4 4"]:
    """Improve each motion by robust Gauss-Newton registration of its piece to the target."""
    groups = len(pieces)
    piece, points = np.repeat(np.arange(groups), [len(p) for p in pieces]), np.concatenate(pieces)
    centres = group_means(points, piece, groups)
    for _ in range(REFINEMENTS):
        p, p_centres = move_points(Ts[piece], points), move_points(Ts, centres)
        distance, match = nearest(target.tree, p)
        hessian, gradient = normal_equations(
            (p - p_centres[piece]) / spacing,
            piece,
            groups,
            target.normals[match],
            (p - target.p[match]) / spacing,
            robust_weight(distance / spacing, SURFACE_REACH),
        )
        hessian += np.eye(6) * (1.0 + 1e-4 * np.trace(hessian, axis1=1, axis2=2))[:, None, None]
        Ts = turn_about(p_centres, -np.linalg.solve(hessian, gradient[..., None])[..., 0], spacing) @ Ts
    return Ts


def _surface_costs(
    nodes: Nodes, source: Surface, target: Surface, Ts: Float64[np.ndarray, "motions 4 4"], spacing: float
) -> Float64[np.ndarray, "nodes motions"]:
    """The cost, in [0, 1], of each node's points under each motion: their distance to the target and their normals."""
    moved = move_points(Ts[:, None], source.p)
    distance, match = nearest(target.tree, moved.reshape(-1, 3))
    turned = source.normals @ np.swapaxes(Ts[:, :3, :3], -1, -2)
    aligned = np.abs((turned.reshape(-1, 3) * target.normals[match]).sum(axis=-1))
    off = np.minimum(distance / spacing / SURFACE_REACH, 1)
    cost = (off + (1 - off) * 0.5 * (1 - aligned)).reshape(len(Ts), len(source.p))
    return group_means(cost.T, nodes.of_point, len(nodes.p))


def _match_costs(
    nodes: Nodes,
    p_from: Float64[np.ndarray, "matches 3"],
    p_to: Float64[np.ndarray, "matches 3"],
    Ts: Float64[np.ndarray, "motions 4 4"],
    spacing: float,
) -> Float64[np.ndarray, "nodes motions"]:
    """The share of each node's matches that each motion leaves unexplained, softly counted; 0 without matches."""
    off = np.linalg.norm(move_points(Ts[:, None], p_from) - p_to, axis=-1) / spacing
    node = nearest(KDTree(nodes.p), p_from)[1]
    return group_means(np.minimum(off / MATCH_REACH, 1).T, node, len(nodes.p))


def _label(
    costs: Float64[np.ndarray, "nodes motions"],
    middles: Float64[np.ndarray, "motions edges 3"],
    edges: Int64[np.ndarray, "edges 2"],
    sweeps: int = 2,
) -> Int64[np.ndarray, "nodes"]:
    """Assign a motion to each node by expansion moves, until none helps or after `sweeps`.

    The cost of an edge grows with the gap that its nodes' motions open at its middle. `middles` are the middles under
    each motion.
    """
    labels = costs.argmin(axis=1)
    node, edge = np.arange(len(costs)), np.arange(len(edges))

    def torn(p: Float64[np.ndarray, "edges 3"], p_other: Float64[np.ndarray, "edges 3"]) -> np.ndarray:
        gap = np.sqrt(((p - p_other) ** 2).sum(axis=1))
        return TOUCH_WEIGHT * np.minimum(gap / TOUCH_REACH, 1)

    for _ in range(sweeps):
        before = labels
        for motion, p in enumerate(middles):
            p_first, p_second = (middles[labels[end], edge] for end in edges.T)
            switches, gain = best_switches(
                costs[node, labels],
                costs[:, motion],
                edges,
                torn(p_first, p_second),
                torn(p, p_second),
                torn(p_first, p),
            )
            if gain > 0:
                labels = np.where(switches, motion, labels)
        if (labels == before).all():
            break
    return labels
