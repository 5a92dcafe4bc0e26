import numpy as np
import pytest
from sklearn.metrics import adjusted_rand_score

from schemas.config import MergingConfig, ProjectionConfig
from stages.merging.stage import compute_merging, touching_parts
from stages.projection.stage import link_parts

MERGING, PROJECTION = MergingConfig(threshold=0.8), ProjectionConfig()


def split_in_four(truth, wobble=0.0):
    """Each true part cut in two by a plane, with motions that differ by `wobble`."""
    p = truth.sequence.frames()[2]
    labels = 2 * truth.canonical_labels + (p[:, 1] > 0)
    Ts = truth.Ts_frame_canonical[:, [0, 0, 1, 1]].copy()
    Ts[[0, 1, 3, 4], 1, 2, 3] += wobble
    return link_parts(p, labels, Ts, 2, PROJECTION)


def test_pieces_of_one_part_are_rejoined_and_parts_kept_apart(two_part_object):
    merged = compute_merging(split_in_four(two_part_object), two_part_object.sequence, MERGING, PROJECTION)
    assert adjusted_rand_score(merged.labels, two_part_object.canonical_labels) == 1.0
    moving = int(merged.labels[two_part_object.canonical_labels == 1][0])
    np.testing.assert_allclose(
        merged.Ts_frame_canonical[:, moving], two_part_object.Ts_frame_canonical[:, 1], atol=1e-9
    )


def test_a_difference_below_the_threshold_merges_and_above_it_does_not(hinge):
    for wobble, parts in ((0.002, 2), (0.05, 3)):
        model = split_in_four(hinge, wobble)
        assert compute_merging(model, hinge.sequence, MERGING, PROJECTION).part_count == parts


def test_threshold_zero_merges_nothing(hinge):
    assert (
        compute_merging(split_in_four(hinge, 0.01), hinge.sequence, MergingConfig(threshold=0), PROJECTION).part_count
        == 4
    )


def test_a_rigid_object_becomes_one_part(hinge):
    p = hinge.sequence.frames()[2]
    Ts = np.tile(np.eye(4), (5, 2, 1, 1))
    model = link_parts(p, hinge.canonical_labels, Ts, 2, PROJECTION)
    merged = compute_merging(model, hinge.sequence, MERGING, PROJECTION)
    assert merged.part_count == 1
    assert len(merged.joint_child) == 0
    assert merged.energies["E_project"] == pytest.approx(0)


def test_touching_parts_are_those_with_neighbouring_points():
    line = np.column_stack([np.arange(60) * 0.01, np.zeros((60, 2))])
    line[:, 1] += 0.001 * (np.arange(60) % 2)
    far = line + [0, 5, 0]
    labels = np.concatenate([np.repeat([0, 1], 30), np.full(60, 2)])
    np.testing.assert_array_equal(touching_parts(np.concatenate([line, far]), labels), [[0, 1]])


def test_pieces_of_one_body_merge_even_where_the_tree_does_not_link_them(hinge):
    model = split_in_four(hinge)
    # a tree that hangs every piece on the lid's first piece instead of on its own body
    detour = model.replace(
        root=2,
        joint_parent=np.array([2, 2, 2]),
        joint_child=np.array([0, 1, 3]),
    )
    assert compute_merging(detour, hinge.sequence, MERGING, PROJECTION).part_count == 2


def test_a_part_of_two_points_keeps_its_motion(hinge):
    labels = hinge.canonical_labels.copy()
    labels[:2] = 2
    Ts = hinge.Ts_frame_canonical[:, [0, 1, 0]].copy()
    Ts[:, 2, 2, 3] += [0.1, 0.2, 0.0, 0.3, 0.4]
    model = link_parts(hinge.sequence.frames()[2], labels, Ts, 2, PROJECTION)
    merged = compute_merging(model, hinge.sequence, MergingConfig(threshold=0.1), PROJECTION)
    part = int(merged.labels[0])
    np.testing.assert_array_equal(merged.Ts_frame_canonical[:, part], Ts[:, 2])
