from dataclasses import replace

import numpy as np
import pytest
from sklearn.metrics import adjusted_rand_score

from schemas.config import AlternatingConfig, RelaxedFitConfig
from stages.kernels.alignment.registration import TRUNCATION, Registration
from stages.kernels.surfaces.surface_graph import SurfaceGraph, surface_graph
from stages.relaxed_fit.alternating import (
    Parts,
    Problem,
    absorb_small_parts,
    absorb_specks,
    merge,
    refine,
    relabel,
    split,
)
from stages.relaxed_fit.stage import compute_relaxed_fit

SETTINGS = AlternatingConfig(points=400, start_parts=6, rounds=4, closing_rounds=2, patches=20, patch_points=30)
CONFIG = RelaxedFitConfig(solver="alternating", alternating=SETTINGS)


def problem_of(truth, settings=SETTINGS):
    registration = Registration(truth.sequence.frames(), 2)
    return Problem(registration, surface_graph(registration.p), settings)


def true_parts(truth):
    return Parts(truth.canonical_labels, truth.Ts_frame_canonical)


def test_finds_the_parts_of_a_known_object(two_part_object):
    truth = two_part_object
    model = compute_relaxed_fit(truth.sequence, truth.true_flow(), 2, CONFIG, np.random.default_rng(0))
    assert adjusted_rand_score(model.labels, truth.canonical_labels) > 0.95
    part = model.labels[-1]
    difference = model.Ts_frame_canonical[:, part] - truth.Ts_frame_canonical[:, 1]
    assert np.abs(difference).max() < 0.05


def test_is_deterministic(hinge):
    first, second = (
        compute_relaxed_fit(hinge.sequence, hinge.true_flow(), 2, CONFIG, np.random.default_rng(seed))
        for seed in (0, 1)
    )
    np.testing.assert_array_equal(first.Ts_frame_canonical, second.Ts_frame_canonical)


def test_labels_cover_all_points_when_the_fit_works_on_fewer(hinge):
    settings = SETTINGS.model_copy(update={"points": 200})
    config = CONFIG.model_copy(update={"alternating": settings})
    model = compute_relaxed_fit(hinge.sequence, hinge.true_flow(), 2, config, np.random.default_rng(0))
    assert len(model.labels) == 400
    assert adjusted_rand_score(model.labels, hinge.canonical_labels) > 0.9


def test_merge_rejoins_a_part_cut_in_two_and_keeps_the_true_ones(hinge):
    cut = 2 * hinge.canonical_labels + (hinge.sequence.frames()[2][:, 1] > 0)
    merged = merge(Parts(cut, hinge.Ts_frame_canonical[:, [0, 0, 1, 1]]), problem_of(hinge))
    assert adjusted_rand_score(merged.labels, hinge.canonical_labels) == 1.0


def test_split_finds_the_part_that_was_overlooked(two_part_object):
    truth = two_part_object
    whole = Parts(np.zeros(400, dtype=int), truth.Ts_frame_canonical[:, :1])
    problem = problem_of(truth)
    parts = whole
    for _ in range(3):
        parts = merge(relabel(refine(split(parts, problem), problem, 6, 5.0), problem), problem)
    assert problem.energy(parts) < problem.energy(whole)
    assert adjusted_rand_score(parts.labels, truth.canonical_labels) > 0.7


def test_relabel_repairs_wrong_labels(hinge):
    rng = np.random.default_rng(0)
    wrong = hinge.canonical_labels.copy()
    flipped = rng.choice(400, size=40, replace=False)
    wrong[flipped] = 1 - wrong[flipped]
    problem = problem_of(hinge)
    repaired = relabel(Parts(wrong, hinge.Ts_frame_canonical), problem)
    assert (repaired.labels != hinge.canonical_labels).sum() <= 4
    assert problem.energy(repaired) <= problem.energy(Parts(wrong, hinge.Ts_frame_canonical))


def test_specks_are_absorbed(hinge):
    labels = hinge.canonical_labels.copy()
    labels[0] = 1
    cleaned = absorb_specks(Parts(labels, hinge.Ts_frame_canonical), problem_of(hinge))
    np.testing.assert_array_equal(cleaned.labels, hinge.canonical_labels)


def test_energy_adds_up_costs_boundaries_and_parts(hinge):
    problem, parts = problem_of(hinge), true_parts(hinge)
    boundary = sum(parts.labels[a] != parts.labels[b] for a, b in problem.graph.edges)
    expected = problem.point_costs(parts).sum() + boundary * SETTINGS.boundary_price + 2 * SETTINGS.part_price
    assert problem.energy(parts) == pytest.approx(expected)


def with_a_small_part(truth, size):
    """The true parts, but for the `size` points of part 1 nearest to part 0, which are a part of their own and touch
    both; and the problem."""
    p = truth.sequence.frames()[2]
    labels = truth.canonical_labels.copy()
    moving = np.flatnonzero(labels == 1)
    small = moving[np.argsort(p[moving, 0])[:size]]
    labels[small] = 2
    problem = problem_of(truth, SETTINGS.model_copy(update={"min_part_share": 0.03}))
    bridges = np.column_stack([np.arange(size), small])
    lengths = np.linalg.norm(p[bridges[:, 0]] - p[bridges[:, 1]], axis=1)
    graph = problem.graph
    graph = SurfaceGraph(400, np.concatenate([graph.edges, bridges]), np.concatenate([graph.lengths, lengths]))
    return Parts(labels, truth.Ts_frame_canonical[:, [0, 1, 1]]), replace(problem, graph=graph)


def test_small_parts_go_where_their_points_move_best(two_part_object):
    parts, problem = with_a_small_part(two_part_object, 11)
    absorbed = absorb_small_parts(parts, problem)
    np.testing.assert_array_equal(absorbed.labels, two_part_object.canonical_labels)
    np.testing.assert_array_equal(absorbed.Ts, two_part_object.Ts_frame_canonical)


def test_parts_large_enough_stay(hinge):
    parts, problem = with_a_small_part(hinge, 12)
    np.testing.assert_array_equal(absorb_small_parts(parts, problem).labels, parts.labels)


def test_a_small_part_that_touches_no_other_stays(hinge):
    parts, problem = with_a_small_part(hinge, 5)
    inside = (parts.labels[problem.graph.edges] == 2).sum(axis=1) != 1
    graph = SurfaceGraph(400, problem.graph.edges[inside], problem.graph.lengths[inside])
    absorbed = absorb_small_parts(parts, replace(problem, graph=graph))
    np.testing.assert_array_equal(absorbed.labels, parts.labels)


def test_the_final_fit_truncates_costs_as_the_relaxed_fit_does_by_default():
    assert AlternatingConfig().truncation == TRUNCATION
