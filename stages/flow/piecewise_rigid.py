"""Which rigid motion each place of a surface makes, from matches of which most may be wrong.

Articulated things move piece by piece. Rigid motions are guessed from triples of matches near each other that keep
their distances, where they explain the matches around, and improved by registering the surface around to the target.
Then every node takes one of them by minimum cuts: one that lays its neighbourhood onto the target, agrees with its
matches, and keeps it in touch with its neighbours on the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.alignment.registration import group_means, normal_equations, robust_weight, turn_about
from stages.kernels.labelling.graph_cut import best_switches
from stages.kernels.motion.rigid_motion import best_rotation, move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points, normals

# Lengths are in units of the clouds' spacing.
SEEDS = 64  # places around which motions are guessed
PATCH_MATCHES = 80  # nearest to a seed, that triples are drawn from
PATCH_POINTS = 60  # nearest to a seed, that are registered
TRIPLES, SCREENED = 400, 40  # drawn around each seed, and how many that keep distances are tried
KEPT = 4  # distinct motions that each seed keeps
LENGTH_CHANGE, LEAST_SIDE = 4.0, 3.0  # most that a triple's distances may change, and what they are at least
MATCH_REACH = 4.0  # a motion explains a match within this distance
SURFACE_REACH = 3.0  # distance from the target beyond which all is equally bad
TOUCH_REACH = 12.0  # neighbours torn apart farther than this are equally bad
REFINEMENTS = 5  # registration steps of a motion
DISTINCT = 2.5  # motions that differ by less on the patch of one are the same
MOST_MOTIONS = 60
MATCH_WEIGHT, TOUCH_WEIGHT = 0.5, 0.12  # of disagreeing matches and of an edge torn, against a node off the target
ROUNDS = 2  # of labelling and registering


@dataclass(frozen=True)
class Surface:
    """A cloud and its normals, of no particular sign."""

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
    """Where motions are wanted, which of them touch (each pair once), and the node that each source point follows."""

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
    """The motion of each node from the source to the target cloud: none, or one of those that matches suggest.

    Matches take points `p_from` near the source to `p_to` near the target; `spacing` is the clouds' spacing.
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
    """Motions that explain many matches around a seed, and whose seed; from triples that keep their distances."""
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
    Ts = _kabsch(corners[row[..., 0], chosen], images[row[..., 0], chosen])
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


def _kabsch(
    a: Float64[np.ndarray, "*batch points 3"], b: Float64[np.ndarray, "*batch points 3"]
) -> Float64[np.ndarray, "*batch 4 4"]:
    """The rigid motions that best take points a to b."""
    centre_a, centre_b = a.mean(axis=-2, keepdims=True), b.mean(axis=-2, keepdims=True)
    Ts = np.zeros((*a.shape[:-2], 4, 4))
    Ts[..., :3, :3] = R = best_rotation(np.swapaxes(a - centre_a, -1, -2) @ (b - centre_b))
    Ts[..., :3, 3] = (centre_b - centre_a @ np.swapaxes(R, -1, -2))[..., 0, :]
    Ts[..., 3, 3] = 1.0
    return Ts


def _distinct(
    Ts: Float64[np.ndarray, "motions 4 4"],
    seed: Int64[np.ndarray, "motions"],
    seeds: Float64[np.ndarray, "seeds 3"],
    source: Surface,
    target: Surface,
    spacing: float,
) -> Float64[np.ndarray, "distinct 4 4"]:
    """Motions registered on the surface around their seeds, those that fit best first, each once."""
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
    """Each motion improved so that it lays its own piece onto the target, by robust Gauss-Newton."""
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
    """How far each node's points are off the target under each motion, and how much their normals differ; 0 to 1."""
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
    """How many of a node's matches each motion leaves unexplained, 0 to 1; 0 where a node has none."""
    off = np.linalg.norm(move_points(Ts[:, None], p_from) - p_to, axis=-1) / spacing
    node = nearest(KDTree(nodes.p), p_from)[1]
    return group_means(np.minimum(off / MATCH_REACH, 1).T, node, len(nodes.p))


def _label(
    costs: Float64[np.ndarray, "nodes motions"],
    middles: Float64[np.ndarray, "motions edges 3"],
    edges: Int64[np.ndarray, "edges 2"],
    sweeps: int = 2,
) -> Int64[np.ndarray, "nodes"]:
    """The motion of each node, by expansion moves until none helps or `sweeps` are over.

    An edge costs how far the motions of its ends take its middle apart: `middles` are where each motion takes it.
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
