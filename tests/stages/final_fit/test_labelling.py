from dataclasses import replace

import numpy as np
import pytest

from stages.final_fit.labelling import LabelProblem, fuse, relabel
from stages.final_fit.working import Fit
from stages.kernels.alignment.registration import Registration
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, nearest

SETTINGS = (5, 1.5, 0.008)  # fused frames, price of a boundary, least share


def flipped(case, count, seed=0):
    labels = case.labels.copy()
    chosen = np.random.default_rng(seed).choice(len(labels), size=count, replace=False)
    labels[chosen] = 1 - labels[chosen]
    return Fit(case.chain, labels)


def test_relabel_repairs_flipped_labels(two_parts):
    wrong = flipped(two_parts, 40)
    repaired = relabel(wrong, two_parts.frames, *SETTINGS)
    assert (repaired.labels != two_parts.labels).sum() <= 4
    assert repaired.chain is wrong.chain


def test_true_labels_stay(two_parts):
    np.testing.assert_array_equal(relabel(two_parts.fit, two_parts.frames, *SETTINGS).labels, two_parts.labels)


def test_parts_that_no_point_shows_get_points(housed):
    for labels in (np.array([0, 0, 2])[housed.labels], np.zeros_like(housed.labels)):
        relabelled = relabel(Fit(housed.chain, labels), housed.frames, *SETTINGS)
        assert np.bincount(relabelled.labels, minlength=3).min() > 0


@pytest.mark.parametrize("part", [0, 2])
def test_no_part_is_left_without_points_where_two_move_alike(housed, part):
    """A part cut in two by a plane, whose halves a joint links that rests."""
    chain = housed.chain
    rest = still(replace(chain.joint(1), parent=part, child=3))
    beyond = housed.frames.p[:, 0] > np.median(housed.frames.p[housed.labels == part, 0])
    labels = np.where((housed.labels == part) & beyond, 3, housed.labels)
    fit = Fit(chain.with_joints([chain.joint(0), chain.joint(1), rest]), labels)
    counts = np.bincount(relabel(fit, housed.frames, *SETTINGS).labels, minlength=4)
    assert counts.min() > 0, counts


@pytest.mark.parametrize("suits", [[], [3]])
def test_a_part_without_points_gets_none_that_is_another_parts_only_one(suits):
    costs = np.zeros((4, 3))
    costs[:, 2] = np.inf
    costs[suits, 2] = 1.0
    problem = LabelProblem(costs, np.zeros((0, 2), dtype=np.int64), np.zeros(0))
    labels = problem.with_every_part(np.array([0, 1, 1, 1]), 4)
    assert np.bincount(labels).tolist() == [1, 2, 1]
    assert not suits or labels[suits] == 2


def still(joint):
    return replace(joint, states=0 * joint.states)


def test_points_go_only_to_parts_that_touch_or_are_linked_to_theirs(housed):
    """All rests, as the body does by the tree; it would suit the arm's points best, but the arm is far above it."""
    T_canonical = np.linalg.inv(housed.chain.Ts)[:, housed.labels]
    up = np.where(housed.labels == 2, 0.2, 0.0)[:, None] * [0, 0, 1]
    clouds = [move_points(T, p) + up for T, p in zip(T_canonical, housed.frames.registration.frames, strict=True)]
    frames = replace(housed.frames, registration=Registration(clouds, 2), p_all=clouds[2])
    labels = relabel(housed.fit, frames, 1, 1.5, 0.008).labels
    assert not (labels[housed.labels == 2] == 0).any()
    assert (labels[housed.labels == 1] == 0).any()


def test_fused_points_lie_on_their_own_parts_canonical_surface(hinge_case):
    p, labels = fuse(hinge_case.fit, hinge_case.frames, 5)
    assert len(p) == len(labels) == 5 * 400
    np.testing.assert_array_equal(p[:400], hinge_case.frames.p)
    np.testing.assert_array_equal(np.bincount(labels), [1000, 1000])
    for part in (0, 1):
        own = hinge_case.frames.p[hinge_case.labels == part]
        distance = nearest(KDTree(own), p[labels == part])[0]
        assert distance.max() < 6 * hinge_case.frames.spacing
    assert len(fuse(hinge_case.fit, hinge_case.frames, 1)[0]) == 400
    assert len(fuse(hinge_case.fit, hinge_case.frames, 3)[0]) == 3 * 400
    assert len(fuse(hinge_case.fit, hinge_case.frames, 99)[0]) == 5 * 400


@pytest.fixture
def line():
    """Ten points in a row, at 1 each of which part 1 is dearer by ever more; the last may not have it."""
    costs = np.column_stack([np.zeros(10), 0.1 + 0.1 * np.arange(10), np.full(10, 9.0)])
    costs[9, 1] = np.inf
    return LabelProblem(costs, np.column_stack([np.arange(9), np.arange(1, 10)]), np.full(9, 0.05))


def test_expanding_lowers_the_energy_and_stays_where_a_part_may_be(line):
    labels = np.zeros(10, dtype=int)
    np.testing.assert_array_equal(line.expand(labels, 1), labels)
    np.testing.assert_array_equal(line.expand(labels, 1, bonus=0.36), np.arange(10) < 3)
    np.testing.assert_array_equal(line.expand(labels, 1, bonus=50.0), np.arange(10) < 9)
    np.testing.assert_array_equal(labels, 0)


@pytest.mark.parametrize("least", [1, 3, 7, 9.0])
def test_a_part_grows_to_its_least_by_the_cheapest_points(line, least):
    grown = line.grow(np.zeros(10, dtype=int), 1, least)
    count = np.count_nonzero(grown)
    assert least <= count < least + 4
    np.testing.assert_array_equal(grown, np.arange(10) < count)


def test_a_part_that_no_bonus_wins_points_gets_the_nearest_to_being_its_own(line):
    grown = line.grow(np.zeros(10, dtype=int), 2, 2.5)
    assert np.count_nonzero(grown == 2) == 3


def test_a_part_with_enough_points_does_not_grow(line):
    labels = np.repeat([0, 1], 5)
    assert line.grow(labels, 1, 5) is labels
