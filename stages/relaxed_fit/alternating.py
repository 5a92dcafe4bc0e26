"""Solver `alternating`: motions, labels and the set of parts improved in turn, without any learning.

One energy says which labels and parts are better: the cost of every point under its part's motion in all
frames, a price for every surface edge between two parts (Potts), and a price for every part. Motions come
from registration of all parts together, from model to frames and back, labels from minimum cuts, fewer parts
from trying one motion for two, more parts from registering small patches of the surface by themselves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int64

from schemas.config import AlternatingConfig, RelaxedFitConfig
from schemas.flow import Flow
from schemas.relaxed import RelaxedModel
from schemas.sequence import PointSequence
from stages.flow.trajectories import follow_flow
from stages.kernels.alignment.evidence import price_over
from stages.kernels.alignment.registration import Registration
from stages.kernels.labelling.graph_cut import expansion_move
from stages.kernels.motion.rigid_clustering import moments, rigid_motion
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points, working_points
from stages.kernels.surfaces.surface_graph import SurfaceGraph, surface_graph
from stages.relaxed_fit.bodies.start import Bodies, are_far_apart
from stages.relaxed_fit.start import start_from_flow
from stages.support.progress import Progress

MERGE_SAMPLE = 120  # points of a part that stand for it when a merge is tried
MIN_PATCH = 12  # a part is not founded on fewer points
SPECK = 0.004  # connected pieces with a smaller share of the points are no parts
OUT_OF_REACH = np.inf  # cost of a label that a point does not consider


@dataclass(frozen=True)
class Parts:
    """A labelling of the working points and each part's motions; every label is used."""

    labels: Int64[np.ndarray, "points"]
    Ts: Float64[np.ndarray, "frames parts 4 4"]

    @property
    def count(self) -> int:
        return self.Ts.shape[1]

    def compact(self) -> Parts:
        """Without parts that have no points."""
        used, labels = np.unique(self.labels, return_inverse=True)
        return Parts(labels.astype(np.int64), np.ascontiguousarray(self.Ts[:, used]))


@dataclass(frozen=True)
class Problem:
    """What does not change while parts do."""

    registration: Registration
    graph: SurfaceGraph
    config: AlternatingConfig

    @property
    def everything(self) -> Int64[np.ndarray, "points"]:
        return np.arange(len(self.registration.p))

    @cached_property
    def prices(self) -> Float64[np.ndarray, "edges"]:
        """What each surface edge costs when it runs between two parts."""
        return np.full(len(self.graph.edges), self.config.boundary_price)

    def point_costs(self, parts: Parts) -> Float64[np.ndarray, "points"]:
        return self.registration.cost(self.everything, parts.labels, parts.Ts)

    def energy(self, parts: Parts) -> float:
        """What the solver lowers: points' costs, price of boundaries, price of parts."""
        boundary = int(self.graph.crossings(parts.labels)[1].sum())
        prices = self.config.boundary_price * boundary + self.config.part_price * parts.count
        return float(self.point_costs(parts).sum() + prices)


def solve_alternating(
    sequence: PointSequence,
    flow: Flow,
    canonical_frame: int,
    config: RelaxedFitConfig,
    rng: np.random.Generator,
    progress: Progress,
) -> RelaxedModel:
    """Fit parts and motions by alternation; deterministic, `rng` is not drawn from.

    Where frames are few or far apart, bodies that are found one by one compete with the parts that the flow led to.
    """
    settings = config.alternating
    frames = [frame[working_points(frame, settings.points)] for frame in sequence.frames()]
    registration = Registration(frames, canonical_frame, settings.truncation, sequence.viewpoints)
    settings = settings.model_copy(update={"part_price": price_over(registration.evidence, settings.part_price)})
    trajectories = follow_flow(registration.p, sequence, flow, canonical_frame, config.energy.flow_neighbours)
    problem = Problem(registration, surface_graph(registration.p), settings)
    start = start_from_flow(registration.p, trajectories, settings.start_parts)
    parts = Parts(start.labels, start.Ts_frame_canonical)
    history = []
    for round_ in range(settings.rounds):
        parts = refine(parts, problem, 6 if round_ == 0 else 3, settings.reach_first if round_ == 0 else settings.reach)
        parts = merge(relabel(parts, problem), problem)
        if round_ < settings.rounds - settings.closing_rounds:
            parts = split(parts, problem)
        history.append([problem.energy(parts)])
        progress(round_ + 1, settings.rounds, history[-1][0] / len(registration.p))
    parts = absorb_small_parts(absorb_specks(parts, problem), problem)
    if are_far_apart(flow, len(frames), config.bodies):
        parts = _better(parts, Bodies.of(frames, canonical_frame, config.bodies), registration.p)
    parts = refine(parts, problem, 4, settings.reach_last)
    p_all = sequence.frames()[canonical_frame]
    return RelaxedModel(
        canonical_frame=canonical_frame,
        labels=parts.labels[nearest(KDTree(registration.p), p_all)[1]],
        Ts_frame_canonical=parts.Ts,
        energy_history=np.array(history),
        energy_names=("E_alternating",),
        solver="alternating",
        iterations=settings.rounds,
    )


def _better(parts: Parts, bodies: Bodies, p: Float64[np.ndarray, "points 3"]) -> Parts:
    """The parts, or the bodies that are found where these explain the frames at a lower energy."""
    found = bodies.find()
    if found.energy > bodies.energy(p, parts.labels, parts.Ts):
        return parts
    start = bodies.start(found, p)
    return Parts(start.labels, start.Ts_frame_canonical).compact()


def refine(parts: Parts, problem: Problem, iterations: int, reach: float) -> Parts:
    """All parts' motions registered anew."""
    edges = problem.graph.edges
    touching = edges[parts.labels[edges[:, 0]] != parts.labels[edges[:, 1]]]
    attachment = problem.config.attachment
    Ts = problem.registration.refine_parts(parts.labels, parts.Ts, touching, iterations, reach, attachment)
    return replace(parts, Ts=Ts)


def relabel(parts: Parts, problem: Problem, sweeps: int = 2) -> Parts:
    """Every point with its own part or one that its part touches, by expansion moves."""
    costs = _costs_within_reach(parts, problem)
    labels = parts.labels
    for _ in range(sweeps):
        before = labels
        for part in range(parts.count):
            nodes = np.flatnonzero((costs[:, part] < OUT_OF_REACH) & (labels != part))
            if len(nodes) == 0:
                continue
            switches, gain = expansion_move(
                labels,
                part,
                nodes,
                costs[nodes, labels[nodes]],
                costs[nodes, part],
                problem.graph.edges,
                problem.prices,
            )
            if gain > 0:
                labels = labels.copy()
                labels[nodes[switches]] = part
        if labels is before:
            break
    return replace(parts, labels=labels).compact()


def _costs_within_reach(parts: Parts, problem: Problem) -> Float64[np.ndarray, "points parts"]:
    """Costs of each point under its own part and the parts that this one touches."""
    touching = np.eye(parts.count, dtype=bool)
    pairs = problem.graph.crossings(parts.labels)[0]
    touching[pairs[:, 0], pairs[:, 1]] = touching[pairs[:, 1], pairs[:, 0]] = True
    point, part = np.nonzero(touching[parts.labels])
    costs = np.full((len(parts.labels), parts.count), OUT_OF_REACH)
    costs[point, part] = problem.registration.cost(point, part, parts.Ts)
    return costs


def merge(parts: Parts, problem: Problem) -> Parts:
    """Touching parts joined wherever one motion, refitted to both, lowers the energy; the best pairs first."""
    while True:
        merged = _merge_once(parts, problem)
        if merged is parts:
            return parts
        parts = merged


def _merge_once(parts: Parts, problem: Problem) -> Parts:
    """Each part joined with at most one other."""
    registration, config = problem.registration, problem.config
    pairs, boundaries = problem.graph.crossings(parts.labels)
    wide = boundaries >= config.contact
    pairs, boundaries = pairs[wide], boundaries[wide]
    if len(pairs) == 0:
        return parts
    members = [np.flatnonzero(parts.labels == part) for part in range(parts.count)]
    samples = [member[:: -(-len(member) // MERGE_SAMPLE)] for member in members]
    T_points = parts.Ts[:, parts.labels]
    trajectories = np.einsum("tnij,nj->tni", T_points[..., :3, :3], registration.p) + T_points[..., :3, 3]
    own = moments(registration.p, trajectories, parts.labels, parts.count)
    # three starts a pair: either part's motion, and the rigid motion nearest to both
    common = rigid_motion(own[pairs[:, 0]] + own[pairs[:, 1]]).transpose(1, 0, 2, 3)
    Ts = np.stack([parts.Ts[:, pairs[:, 0]], parts.Ts[:, pairs[:, 1]], common], axis=2).reshape(
        -1, 3 * len(pairs), 4, 4
    )
    unions = [np.concatenate([samples[a], samples[b]]) for a, b in pairs for _ in range(3)]
    index = np.concatenate(unions)
    group = np.repeat(np.arange(len(unions)), [len(union) for union in unions])
    Ts = registration.refine_groups(index, group, Ts, config.merge_iterations, config.reach)
    shares = np.array([len(member) / len(sample) for member, sample in zip(members, samples, strict=True)])
    rise = registration.cost(index, group, Ts) - problem.point_costs(parts)[index]
    rises = np.bincount(group, rise * shares[parts.labels[index]], minlength=len(unions)).reshape(-1, 3)
    gains = config.part_price + config.boundary_price * boundaries - rises.min(axis=1)
    labels, motions, joined = parts.labels.copy(), parts.Ts.copy(), set[int]()
    for pair in np.argsort(-gains, kind="stable"):
        a, b = pairs[pair].tolist()
        if gains[pair] <= 0:
            break
        if joined.isdisjoint((a, b)):
            joined |= {a, b}
            labels[labels == b] = a
            motions[:, a] = Ts[:, 3 * pair + rises[pair].argmin()]
    return Parts(labels, motions).compact() if joined else parts


def split(parts: Parts, problem: Problem) -> Parts:
    """New parts founded on patches of the surface that fit better with a motion of their own."""
    registration, config = problem.registration, problem.config
    seeds = farthest_points(registration.p, config.patches)
    along = problem.graph.distances(seeds, config.patch_points * registration.spacing)
    nearest_first = np.argsort(along, axis=1, kind="stable")[:, : config.patch_points]
    reached = np.isfinite(np.take_along_axis(along, nearest_first, axis=1))
    index, patch = nearest_first[reached], np.nonzero(reached)[0]
    Ts = registration.refine_groups(
        index, patch, parts.Ts[:, parts.labels[seeds]], config.patch_iterations, config.reach
    )
    saved = problem.point_costs(parts)[index] - registration.cost(index, patch, Ts)
    savings = np.bincount(patch, saved, minlength=len(seeds))
    around = 4.0 * np.sqrt(config.patch_points) * registration.spacing
    for seed in np.argsort(-savings, kind="stable"):
        if savings[seed] < 0.3 * config.part_price:
            break
        parts = _try_part(parts, Ts[:, seed : seed + 1], np.flatnonzero(along[seed] < around), problem)
    return parts.compact()


def _try_part(
    parts: Parts, T_new: Float64[np.ndarray, "frames 1 4 4"], nodes: Int64[np.ndarray, "near"], problem: Problem
) -> Parts:
    """A further part of those nodes that are better off with it, if that pays for its price."""
    registration, config = problem.registration, problem.config
    stay = registration.cost(nodes, parts.labels[nodes], parts.Ts)
    for attempt in range(2):
        switch = registration.cost(nodes, np.zeros_like(nodes), T_new)
        switches, gain = expansion_move(
            parts.labels, parts.count, nodes, stay, switch, problem.graph.edges, problem.prices
        )
        chosen = nodes[switches]
        if len(chosen) < MIN_PATCH:
            return parts
        if attempt == 0:
            T_new = registration.refine_groups(
                chosen, np.zeros_like(chosen), T_new, config.patch_iterations, config.reach
            )
    if gain <= config.part_price:
        return parts
    labels = parts.labels.copy()
    labels[chosen] = parts.count
    return Parts(labels, np.concatenate([parts.Ts, T_new], axis=1))


def absorb_specks(parts: Parts, problem: Problem) -> Parts:
    """Connected pieces too small to be parts given to the part that they touch most."""
    least = SPECK * len(parts.labels)
    pieces = problem.graph.components(parts.labels)
    labels = parts.labels.copy()
    a, b = problem.graph.edges.T
    for piece in np.flatnonzero(np.bincount(pieces) < least):
        inside_a, inside_b = pieces[a] == piece, pieces[b] == piece
        around = np.concatenate([labels[b[inside_a & ~inside_b]], labels[a[inside_b & ~inside_a]]])
        if len(around):
            labels[pieces == piece] = np.bincount(around).argmax()
    return Parts(labels, parts.Ts).compact()


def absorb_small_parts(parts: Parts, problem: Problem) -> Parts:
    """Parts too small to tell from noise given, smallest first, to the touching part whose motion suits them best."""
    least = problem.config.min_part_share * len(parts.labels)
    labels = parts.labels.copy()
    for part in np.argsort(np.bincount(labels, minlength=parts.count), kind="stable").tolist():
        members = np.flatnonzero(labels == part)
        if len(members) >= least:
            continue
        pairs = problem.graph.crossings(labels)[0]
        touching = np.setdiff1d(pairs[(pairs == part).any(axis=1)], [part])
        if len(touching):
            point, group = np.repeat(members, len(touching)), np.tile(touching, len(members))
            costs = problem.registration.cost(point, group, parts.Ts)
            labels[members] = touching[costs.reshape(len(members), -1).sum(axis=0).argmin()]
    return Parts(labels, parts.Ts).compact()
