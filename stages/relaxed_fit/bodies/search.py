"""The search for bodies: what is explained is taken out, and what is left over is followed as the next body.

A body turns about or slides along one axis against a body that it touches, over all targets at once. So each candidate
axis is swept over all targets. The energy of the whole decides whether a body is accepted.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse.csgraph import connected_components

from schemas.joints import PRISMATIC, REVOLUTE
from stages.kernels.alignment.fit_cost import fit_costs, refine_motions
from stages.kernels.alignment.oriented_cloud import OrientedCloud
from stages.kernels.kinematics.closed_form import fit_joint
from stages.kernels.motion.rigid_motion import inverse, move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points
from stages.relaxed_fit.bodies.axes import Axes, axes_of_shape, axis_of_motion, share_on_surface
from stages.relaxed_fit.bodies.scene import FEWEST_POINTS, Explanation, Scene

MOST_BODIES = 12
LEFT_OVER = 0.5  # cost, smoothed over the surroundings, above which a point is not explained
LEAST_POINTS = 14  # of a piece that may be a body
TRIED_PIECES, TRIED_PARENTS, TRIED_MOTIONS = 6, 2, 5
SWEPT_POINTS, REFINED_POINTS = 80, 200
ANGLES = np.radians(np.arange(-174.0, 181.0, 6.0))
SLIDE_STEP = 1.5  # in spacings
LONGEST_SLIDE = 0.7  # of the diagonal
FREE_STARTS, FREE_KEPT = 12, 6  # motions for each target that are refined, and those whose axes are swept
COARSE_REACHES, FINE_REACHES, LAST_REACHES = (4.0, 3.0, 2.5, 2.0, 1.5, 1.5), (3.0, 2.0, 2.0, 1.5), (2.0, 1.5, 1.5)
EXPLAINED_WEIGHT = 0.4  # of a target point that something else explains, when a candidate is scored
OFF_SURFACE_PRICE, OFF_SURFACE = 0.15, 4.0  # of an axis that runs farther from the body's surface, in spacings
TURN_PRICE = 0.05 / np.pi  # per radian
DRIFT_PRICE, MOST_DRIFT, HELD_DRIFT = 0.15, 2.0, 1.5  # of motions that no single axis makes; drifts in spacings
DISTINCT = 1.0  # mean distance, in spacings, between different motions


def explain(explanation: Explanation, diagonal: float) -> Explanation:
    """Add bodies as long as one lowers the energy. `diagonal` is the extent of the source, in spacings."""
    failed: list[Int64[np.ndarray, "piece"]] = []
    while len(explanation.Ts) < MOST_BODIES:
        pieces = [piece for piece in left_over(explanation) if not any(_alike(piece, one) for one in failed)]
        for piece in pieces[:TRIED_PIECES]:
            found = _best_with(explanation, piece, diagonal)
            if found is not None and found.energy < explanation.energy:
                explanation = found.polished(2, LAST_REACHES)
                break
            failed.append(piece)
        else:
            break
    return explanation


def left_over(explanation: Explanation) -> list[Int64[np.ndarray, "piece"]]:
    """Connected pieces of the source that no body explains in some targets, largest first."""
    smooth = explanation.own_costs[:, explanation.scene.around].mean(axis=-1)
    worse_half = np.sort(smooth, axis=0)[len(smooth) // 2 :].mean(axis=0)
    left = worse_half > LEFT_OVER
    graph = explanation.scene.graph
    a, b = graph.edges.T
    pieces = connected_components(graph.adjacency(np.ones(len(graph.edges)), left[a] & left[b]), directed=False)[1]
    members = [np.flatnonzero(left & (pieces == piece)) for piece in np.unique(pieces[left])]
    return sorted((one for one in members if len(one) >= LEAST_POINTS), key=len, reverse=True)


def _alike(piece: Int64[np.ndarray, "piece"], other: Int64[np.ndarray, "other"]) -> bool:
    return len(np.intersect1d(piece, other)) > 0.8 * max(len(piece), len(other))


def _best_with(explanation: Explanation, piece: Int64[np.ndarray, "piece"], diagonal: float) -> Explanation | None:
    """The explanation of least energy with a further body that a left-over piece is the core of."""
    inside = np.zeros(len(explanation.labels), dtype=bool)
    inside[piece] = True
    left = explanation.scene.costs_back(explanation.labels, explanation.Ts, ~inside)
    found = [
        _with_body(explanation, piece, parent, Ts, left)
        for parent in _parents(explanation, inside)
        for Ts in _candidate_motions(explanation, piece, parent, left, diagonal)
    ]
    return min((one for one in found if one is not None), key=lambda one: one.energy, default=None)


def _parents(explanation: Explanation, inside: Bool[np.ndarray, "points"]) -> list[int]:
    """The bodies that a piece touches most, or those nearest to it where it hangs apart."""
    a, b = explanation.scene.graph.edges.T
    touched = np.concatenate([b[inside[a] & ~inside[b]], a[inside[b] & ~inside[a]]])
    if len(touched) == 0:
        p, outside = explanation.scene.source.p, np.flatnonzero(~inside)
        touched = outside[nearest(KDTree(p[outside]), p[inside])[1]] if len(outside) else np.flatnonzero(inside)
    bodies, counts = np.unique(explanation.labels[touched], return_counts=True)
    return bodies[np.argsort(-counts, kind="stable")][:TRIED_PARENTS].tolist()


def _candidate_motions(
    explanation: Explanation,
    piece: Int64[np.ndarray, "piece"],
    parent: int,
    left: list[Float64[np.ndarray, "target_points"]],
    diagonal: float,
) -> list[Float64[np.ndarray, "targets 4 4"]]:
    """The best distinct motions of a piece about or along one axis, which moves with the parent.

    Axes of the shape are swept first. The best motion in each target, refined without an axis, gives further axes.
    """
    scene, T_parent = explanation.scene, explanation.Ts[parent]
    p = scene.source.p[piece]
    few = scene.source.take(piece[farthest_points(p, SWEPT_POINTS)])
    more = scene.source.take(piece[farthest_points(p, REFINED_POINTS)])
    weights = [EXPLAINED_WEIGHT + (1.0 - EXPLAINED_WEIGHT) * one for one in left]
    axes = axes_of_shape(scene.source.take(piece), _border(scene, piece), scene.source)
    scores, amounts = _sweep(scene, axes, T_parent, few, weights, diagonal)
    further = []
    for t, target in enumerate(scene.targets):
        best = np.argsort(-scores[:, t], kind="stable")[:FREE_STARTS]
        starts = np.concatenate([T_parent[t] @ axes.transforms(axis, amounts[[axis], t]) for axis in best])
        Ts = refine_motions(target, more, starts, COARSE_REACHES, weights[t])
        costs, index = fit_costs(target, more, Ts)
        order = np.argsort(-((1.0 - costs) * weights[t][index]).mean(axis=1), kind="stable")[:FREE_KEPT]
        further += [axis_of_motion(inverse(T_parent[t]) @ Ts[k]) for k in order]
    free = Axes.of(axis for axis in further if axis is not None)
    free_scores, free_amounts = _sweep(scene, free, T_parent, few, weights, diagonal)
    axes, scores, amounts = axes + free, np.concatenate([scores, free_scores]), np.concatenate([amounts, free_amounts])
    score = scores.mean(axis=1) - OFF_SURFACE_PRICE * (1.0 - share_on_surface(axes, p, OFF_SURFACE))
    chosen: list[tuple[np.ndarray, np.ndarray]] = []
    for axis in np.argsort(-score, kind="stable"):
        Ts = T_parent @ axes.transforms(axis, amounts[axis])
        moved = move_points(Ts[:, None], more.p)
        if all(np.abs(moved - other).mean() > DISTINCT for other, _ in chosen):
            chosen.append((moved, Ts))
        if len(chosen) == TRIED_MOTIONS:
            break
    return [scene.refined(piece, Ts, COARSE_REACHES, weights) for _, Ts in chosen]


def _border(scene: Scene, piece: Int64[np.ndarray, "piece"]) -> Float64[np.ndarray, "border 3"]:
    """The middles of the surface edges that lead out of a piece."""
    inside = np.zeros(len(scene.source.p), dtype=bool)
    inside[piece] = True
    a, b = scene.graph.edges.T
    out = inside[a] != inside[b]
    return (scene.source.p[a[out]] + scene.source.p[b[out]]) / 2


def _sweep(
    scene: Scene,
    axes: Axes,
    T_parent: Float64[np.ndarray, "targets 4 4"],
    points: OrientedCloud,
    weights: list[Float64[np.ndarray, "target_points"]],
    diagonal: float,
) -> tuple[Float64[np.ndarray, "axes targets"], Float64[np.ndarray, "axes targets"]]:
    """The best score of each axis in each target over all amounts, and that amount: an angle or a length."""
    scores, amounts = np.zeros((len(axes), len(scene.targets))), np.zeros((len(axes), len(scene.targets)))
    reach = LONGEST_SLIDE * diagonal
    lengths = np.arange(-reach, reach, SLIDE_STEP)
    tried = [ANGLES if turns else lengths for turns in axes.turns]
    motions = [axes.transforms(axis, amount) for axis, amount in enumerate(tried)]
    if not motions:
        return scores, amounts
    bounds = np.cumsum([0, *map(len, tried)])
    price = np.concatenate([TURN_PRICE * np.abs(one) * turns for one, turns in zip(tried, axes.turns, strict=True)])
    for t, target in enumerate(scene.targets):
        costs, index = fit_costs(target, points, T_parent[t] @ np.concatenate(motions))
        score = ((1.0 - costs) * weights[t][index]).mean(axis=1) - price
        for axis in range(len(axes)):
            own = score[bounds[axis] : bounds[axis + 1]]
            scores[axis, t], amounts[axis, t] = own.max(), tried[axis][own.argmax()]
    return scores, amounts


def _with_body(
    explanation: Explanation,
    piece: Int64[np.ndarray, "piece"],
    parent: int,
    Ts: Float64[np.ndarray, "targets 4 4"],
    left: list[Float64[np.ndarray, "target_points"]],
) -> Explanation | None:
    """The explanation with a further body that moves by `Ts`; None where it gets too few points.

    Where one axis makes nearly these motions, it makes them.
    """
    scene, new = explanation.scene, len(explanation.Ts)
    relative = np.concatenate([np.eye(4)[None], inverse(explanation.Ts[parent]) @ Ts])
    joint = fit_joint((REVOLUTE, PRISMATIC), relative, scene.source.p[piece])
    drift = float(joint.rms)
    if drift < HELD_DRIFT:
        Ts = explanation.Ts[parent] @ joint.transforms()[1:]
    penalty = explanation.penalty + DRIFT_PRICE * len(piece) * min(1.0, drift / MOST_DRIFT)
    found = Explanation(scene, explanation.labels, explanation.Ts, explanation.costs, penalty).with_motion(new, Ts)
    bonus = np.zeros((new + 1, len(explanation.labels)))
    bonus[new] = EXPLAINED_WEIGHT * np.mean(_newly_explained(scene, Ts, found.costs[new], left), axis=0)
    found = found.relabelled([new], bonus)
    own = np.flatnonzero(found.labels == new)
    if len(own) < FEWEST_POINTS:
        return None
    return found.with_motion(new, scene.refined(own, Ts, FINE_REACHES)).relabelled(range(new + 1))


def _newly_explained(
    scene: Scene,
    Ts: Float64[np.ndarray, "targets 4 4"],
    costs: Float64[np.ndarray, "targets points"],
    left: list[Float64[np.ndarray, "target_points"]],
) -> list[Float64[np.ndarray, "points"]]:
    """How well each moved point explains a target point that nothing else explains."""
    nearest_index = [
        nearest(target.tree, move_points(T, scene.source.p))[1] for target, T in zip(scene.targets, Ts, strict=True)
    ]
    return [(1.0 - cost) * one[index] for cost, one, index in zip(costs, left, nearest_index, strict=True)]
