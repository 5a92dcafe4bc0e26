"""Labelling of a graph by expansion moves: which points are better off with one given label."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

PRECISION = 1000.0  # capacities are whole numbers: costs are rounded to one part in so many


def expansion_move(
    labels: Int64[np.ndarray, "nodes"],
    alpha: int,
    nodes: Int64[np.ndarray, "free"],
    stay: Float64[np.ndarray, "free"],
    switch: Float64[np.ndarray, "free"],
    edges: Int64[np.ndarray, "edges 2"],
    prices: Float64[np.ndarray, "edges"],
) -> tuple[Bool[np.ndarray, "free"], float]:
    """The best set of `nodes` to be given the label `alpha`, and how much it lowers the energy.

    The energy is the sum of the nodes' costs (`stay` with their present label, `switch` with alpha) plus the
    price of every edge between different labels (Potts). One minimum cut finds the global optimum
    of the move.
    """
    place = np.full(len(labels), -1)
    place[nodes] = np.arange(len(nodes))
    near = (place[edges] >= 0).any(axis=1)
    edges, prices = edges[near], prices[near]
    cost_switch, cost_stay = switch.astype(np.float64), stay.astype(np.float64)
    for inner, outer in (edges.T, edges[:, ::-1].T):  # edges with one end that cannot change
        fixed = place[outer] < 0
        node, other = place[inner[fixed]], labels[outer[fixed]]
        np.add.at(cost_switch, node, prices[fixed] * (other != alpha))
        np.add.at(cost_stay, node, prices[fixed] * (labels[inner[fixed]] != other))
    free = (place[edges] >= 0).all(axis=1)
    i, j = place[edges[free]].T
    both_stay = prices[free] * (labels[nodes[i]] != labels[nodes[j]])
    j_switches = prices[free] * (labels[nodes[i]] != alpha)
    i_switches = prices[free] * (labels[nodes[j]] != alpha)
    return best_switches(cost_stay, cost_switch, np.stack([i, j], axis=1), both_stay, i_switches, j_switches)


def best_switches(
    stay: Float64[np.ndarray, "nodes"],
    switch: Float64[np.ndarray, "nodes"],
    edges: Int64[np.ndarray, "edges 2"],
    both_stay: Float64[np.ndarray, "edges"],
    first_switches: Float64[np.ndarray, "edges"],
    second_switches: Float64[np.ndarray, "edges"],
) -> tuple[Bool[np.ndarray, "nodes"], float]:
    """The best set of nodes to switch, and how much that lowers the energy, by one minimum cut.

    A node costs `stay` or `switch`; an edge costs nothing where both ends switch, else what the last three arrays say.
    It is the global optimum where no edge costs more with both ends staying than with either one switched, together:
    so it is where these are distances, in some metric, between what the ends have and the one thing they switch to.
    """
    i, j = edges.T
    # E(x_i, x_j) = both_stay + (first_switches - both_stay) x_i - first_switches x_j + coupling (1 - x_i) x_j
    switch = switch.copy()
    np.add.at(switch, i, first_switches - both_stay)
    np.add.at(switch, j, -first_switches)
    coupling = second_switches + first_switches - both_stay
    switches = _minimum_cut(switch - stay, i, j, coupling)
    gain = (stay - switch)[switches].sum() - coupling[~switches[i] & switches[j]].sum()
    return switches, float(gain)


def _minimum_cut(
    preference: Float64[np.ndarray, "nodes"],
    i: Int64[np.ndarray, "pairs"],
    j: Int64[np.ndarray, "pairs"],
    coupling: Float64[np.ndarray, "pairs"],
) -> Bool[np.ndarray, "nodes"]:
    """The x that minimises sum(preference x) + sum(coupling (1 - x_i) x_j): false on the source's side of the cut."""
    count = len(preference)
    source, sink = count, count + 1
    dear, cheap = np.flatnonzero(preference > 0), np.flatnonzero(preference < 0)
    rows = np.concatenate([np.full(len(dear), source), cheap, i])
    columns = np.concatenate([dear, np.full(len(cheap), sink), j])
    capacities = np.concatenate([preference[dear], -preference[cheap], coupling])
    whole = np.minimum(np.round(capacities * PRECISION), np.iinfo(np.int32).max // 8).astype(np.int32)
    graph = csr_array((whole, (rows, columns)), shape=(count + 2, count + 2))
    residual = csr_array(graph - maximum_flow(graph, source, sink).flow)
    residual.data[residual.data < 0] = 0
    residual.eliminate_zeros()
    reached = breadth_first_order(residual, source, return_predecessors=False)
    switches = np.ones(count + 2, dtype=bool)
    switches[reached] = False
    return switches[:count]
