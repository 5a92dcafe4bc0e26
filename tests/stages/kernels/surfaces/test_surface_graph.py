import numpy as np
import pytest

from stages.kernels.surfaces.surface_graph import smoothness_weights, surface_graph

LINE = np.column_stack([np.arange(20) * 0.1, np.zeros((20, 2))])


def test_neighbours_are_linked_once_and_gaps_are_not_bridged():
    graph = surface_graph(np.concatenate([LINE, LINE + [0, 3, 0]]), count=2)
    assert len(np.unique(graph.edges, axis=0)) == len(graph.edges)
    assert (graph.edges[:, 0] < graph.edges[:, 1]).all()
    assert ((graph.edges < 20).all(axis=1) | (graph.edges >= 20).all(axis=1)).all()


def test_distances_follow_the_surface():
    circle = np.linspace(0, 1.9 * np.pi, 100)
    points = np.column_stack([np.cos(circle), np.sin(circle), 0 * circle])
    along = surface_graph(points, count=2).distances(np.array([0]), limit=10.0)[0]
    assert along[-1] == pytest.approx(1.9 * np.pi, rel=0.01)
    assert np.isinf(surface_graph(points, count=2).distances(np.array([0]), limit=1.0)[0, -1])


def test_crossings_count_edges_between_labels():
    pairs, counts = surface_graph(LINE, count=2).crossings(np.repeat([2, 0], 10))
    np.testing.assert_array_equal(pairs, [[0, 2]])
    assert counts[0] >= 1


def test_components_are_connected_pieces_of_one_label():
    labels = np.array([0] * 5 + [1] * 10 + [0] * 5)
    pieces = surface_graph(LINE, count=2).components(labels)
    assert len(np.unique(pieces)) == 3
    assert len(np.unique(pieces[:5])) == 1


def sheet(seed=0):
    uv = np.random.default_rng(seed).uniform(size=(700, 2))
    return np.column_stack([uv, np.zeros(700)])


def test_a_flat_surface_bends_nowhere():
    points = sheet()
    np.testing.assert_allclose(smoothness_weights(points, surface_graph(points)), 1)


def test_cuts_along_a_crease_are_cheap_and_the_mean_is_one():
    points = np.concatenate([sheet(0), sheet(1)[:, [2, 1, 0]]])  # two walls that meet at x = z = 0
    graph = surface_graph(points, 8)
    weights = smoothness_weights(points, graph)
    ends = points[graph.edges]
    at_crease = (graph.edges < 700).sum(axis=1) == 1
    elsewhere = (ends[:, 0, 0] < 0.5) != (ends[:, 1, 0] < 0.5)
    assert weights[at_crease].sum() < 0.6 * weights[elsewhere].sum()
    assert weights[at_crease].mean() < 0.5 * weights[elsewhere].mean()
    assert weights.mean() == pytest.approx(1)
    assert weights.min() > 0
    np.testing.assert_allclose(smoothness_weights(1000 * points, graph), weights, atol=1e-9)


def test_a_graph_without_edges_has_no_weights():
    points = np.random.default_rng(0).normal(size=(20, 3))
    graph = surface_graph(points)
    lone = type(graph)(20, graph.edges[:0], graph.lengths[:0])
    assert smoothness_weights(points, lone).shape == (0,)
