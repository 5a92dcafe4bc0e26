import numpy as np
import pytest

from schemas.config import ProjectionConfig
from schemas.joints import REVOLUTE
from schemas.relaxed import RelaxedModel
from stages.projection.stage import (
    base_part,
    compute_projection,
    directed,
    group_energy,
    link_parts,
    middle_part,
    spanning_tree,
    spatial_energies,
    standing_part,
)

CONFIG = ProjectionConfig()


def relaxed_truth(truth):
    return RelaxedModel(
        canonical_frame=2,
        labels=truth.canonical_labels,
        Ts_frame_canonical=truth.Ts_frame_canonical,
        energy_history=np.zeros((0, 4)),
        solver="truth",
        iterations=0,
    )


def test_finds_the_known_joint(two_part_object):
    truth = two_part_object
    model = compute_projection(relaxed_truth(truth), truth.sequence, CONFIG)
    assert model.root == 0
    assert (model.joint_parent.tolist(), model.joint_child.tolist()) == ([0], [1])
    assert abs(model.axis[0] @ truth.axis) == pytest.approx(1, abs=1e-9)
    sign = np.sign(model.axis[0] @ truth.axis)
    both = [truth.states, 0 * truth.states] if truth.kind == REVOLUTE else [0 * truth.states, truth.states]
    np.testing.assert_allclose(sign * model.states, np.concatenate(both, axis=1), atol=1e-6)
    assert model.e_1dof[0] < 1e-10


@pytest.mark.parametrize("contact", [0.0, 0.05, 1.0])
def test_spatial_energy_equals_its_naive_twin(hinge, contact):
    p, labels = hinge.sequence.frames()[2], hinge.canonical_labels
    nearest = min(np.linalg.norm(x - y) for x in p[labels == 0] for y in p[labels == 1])
    energies = spatial_energies(p, labels, contact)
    assert energies[0, 1] == energies[1, 0] == pytest.approx(max(nearest - contact, 0) ** 2)
    assert energies[0, 0] == 0


def test_group_energy_equals_its_naive_twin(hinge):
    p, labels = hinge.sequence.frames()[2], hinge.canonical_labels
    per_part = []
    for part in (0, 1):
        members = [x for x, label in zip(p, labels, strict=True) if label == part]
        centre = sum(members) / len(members)
        per_part.append(sum(((x - centre) ** 2).sum() for x in members) / len(members))
    assert group_energy(p, labels) == pytest.approx(sum(per_part) / 2)


def test_the_root_in_the_middle_has_most_points_near():
    cost = np.full((4, 4), 9.0)
    for a, b in ((0, 1), (1, 2), (2, 3)):
        cost[a, b] = cost[b, a] = 1.0
    tree = spanning_tree(cost)
    assert middle_part(tree, np.array([10, 10, 30, 10])) == 2
    assert middle_part(tree, np.array([90, 10, 30, 10])) == 0


def test_spanning_tree_takes_the_cheapest_links_parents_first():
    cost = np.full((4, 4), 9.0)
    for a, b in ((0, 2), (2, 1), (1, 3)):
        cost[a, b] = cost[b, a] = 1.0
    np.testing.assert_array_equal(directed(spanning_tree(cost), 2), [[2, 0], [2, 1], [1, 3]])


def test_a_one_dof_link_beats_a_nearer_free_one():
    rng = np.random.default_rng(0)
    cluster = rng.normal(scale=0.02, size=(3, 30, 3)) + np.array([[0, 0, 0], [0.3, 0, 0], [0.35, 0.1, 0]])[:, None]
    p, labels = cluster.reshape(-1, 3), np.repeat([0, 1, 2], 30)
    Ts = np.tile(np.eye(4), (6, 3, 1, 1))
    Ts[:, 1, :3, 3] = 0.3 * rng.normal(size=(6, 3))  # part 1 flies freely, part 2 slides against part 0
    Ts[:, 2, 0, 3] = 0.1 * np.arange(6)
    Ts[0] = np.eye(4)
    model = link_parts(p, labels, Ts, 0, ProjectionConfig(lambda_spatial=1.0, lambda_1dof=100.0))
    links = {frozenset(link) for link in zip(model.joint_parent.tolist(), model.joint_child.tolist(), strict=True)}
    assert frozenset((0, 2)) in links


def test_a_single_part_is_a_tree_without_joints(hinge):
    still = hinge.Ts_frame_canonical[:, :1]
    model = link_parts(hinge.sequence.frames()[2], np.zeros(400, dtype=np.int64), still, 2, CONFIG)
    assert (model.part_count, len(model.joint_child), model.root) == (1, 0, 0)


def test_a_base_stands_still_and_a_free_one_is_the_largest_part():
    samples = np.random.default_rng(0).normal(size=(3, 20, 3))
    Ts = np.tile(np.eye(4), (4, 3, 1, 1))
    Ts[1:, :, 0, 3] = [0.0, 0.5, 0.2]
    sizes = np.array([50, 100, 900])
    assert base_part(samples, Ts, sizes, 0.1) == 0
    Ts[1:, :, 1, 3] += 3.0  # the whole moves
    assert base_part(samples, Ts, sizes, 0.1) == 2


def test_the_root_on_the_ground_is_the_largest_part_that_reaches_it():
    rng = np.random.default_rng(0)
    sizes, bottoms = [300, 100, 60], [0.5, 0.0, 0.004]  # the largest part hangs above the other two
    p = np.concatenate([rng.uniform(size=(n, 3)) + [0, 0, z] for n, z in zip(sizes, bottoms, strict=True)])
    assert standing_part(p, np.repeat([0, 1, 2], sizes), 0.05) == 1
