from itertools import product

import numpy as np
import pytest

from stages.kernels.labelling.graph_cut import best_switches, expansion_move


def energy(labels, unary, edges, prices):
    return unary.sum() + prices[labels[edges[:, 0]] != labels[edges[:, 1]]].sum()


@pytest.mark.parametrize("seed", range(12))
def test_the_move_is_the_best_of_all_moves(seed):
    rng = np.random.default_rng(seed)
    count = 9
    labels = rng.integers(0, 3, size=count)
    edges = np.unique(np.sort(rng.integers(0, count, size=(16, 2)), axis=1), axis=0)
    edges = edges[edges[:, 0] != edges[:, 1]]
    nodes = np.sort(rng.choice(count, size=6, replace=False))
    stay, switch = rng.uniform(0, 2, size=(2, 6))
    prices = rng.choice([0.0, 0.2, 0.7, 2.0], size=len(edges))

    def after(move):
        moved = labels.copy()
        moved[nodes[list(move)]] = 7
        return energy(moved, np.where(move, switch, stay), edges, prices)

    moves = [np.array(move) for move in product([False, True], repeat=6)]
    best = min(after(move) for move in moves)
    switches, gain = expansion_move(labels, 7, nodes, stay, switch, edges, prices)
    assert after(switches) == pytest.approx(best, abs=0.02)
    assert gain == pytest.approx(after(moves[0]) - after(switches), abs=1e-9)


def test_nothing_moves_where_staying_is_free():
    labels, nodes = np.zeros(4, dtype=int), np.arange(4)
    edges = np.array([[0, 1], [1, 2], [2, 3]])
    switches, gain = expansion_move(labels, 1, nodes, np.zeros(4), np.ones(4), edges, np.ones(len(edges)))
    assert not switches.any()
    assert gain == 0


def test_smoothness_takes_a_dissenter_along():
    labels, nodes = np.zeros(3, dtype=int), np.arange(3)
    edges = np.array([[0, 1], [1, 2]])
    stay, switch = np.array([2.0, 0.0, 2.0]), np.array([0.0, 0.5, 0.0])
    assert expansion_move(labels, 1, nodes, stay, switch, edges, np.ones(len(edges)))[0].all()
    assert not expansion_move(labels, 1, nodes, stay, switch, edges, np.full(len(edges), 0.1))[0][1]


def test_the_boundary_runs_where_edges_are_cheap():
    labels, nodes = np.zeros(6, dtype=int), np.arange(6)
    edges = np.column_stack([np.arange(5), np.arange(1, 6)])
    stay, switch = np.array([9.0, 0, 0, 0, 0, 0]), np.array([0, 0.1, 0.1, 0.1, 0.1, 9.0])
    for cheap in range(5):
        prices = np.where(np.arange(5) == cheap, 0.5, 3.0)
        switches, gain = expansion_move(labels, 1, nodes, stay, switch, edges, prices)
        np.testing.assert_array_equal(switches, np.arange(6) <= cheap)
        assert gain == pytest.approx(9.0 - 0.1 * cheap - 0.5)


@pytest.mark.parametrize("seed", range(6))
def test_switches_are_the_best_of_all_where_edges_cost_a_distance(seed):
    rng = np.random.default_rng(seed)
    stay, switch = rng.uniform(0, 2, size=(2, 7))
    edges = np.array([(i, j) for i in range(7) for j in range(i) if rng.uniform() < 0.4])
    places, place = rng.uniform(size=(7, 2)), rng.uniform(size=2)

    def energy_of(move):
        p = np.where(move[:, None], place, places)
        gap = np.linalg.norm(p[edges[:, 0]] - p[edges[:, 1]], axis=1)
        return np.where(move, switch, stay).sum() + gap.sum()

    (a, b), to = places[edges.T], np.linalg.norm(places - place, axis=1)
    switches, gain = best_switches(stay, switch, edges, np.linalg.norm(a - b, axis=1), *to[edges.T][::-1])
    best = min(energy_of(np.array(move)) for move in product([False, True], repeat=7))
    assert energy_of(switches) == pytest.approx(best, abs=0.02)
    assert gain == pytest.approx(energy_of(np.zeros(7, dtype=bool)) - energy_of(switches), abs=1e-9)
