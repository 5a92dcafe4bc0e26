from __future__ import annotations

import numpy as np

from stages.kernels.labelling.matching import match_parts


def test_parts_are_matched_one_to_one_by_their_overlap() -> None:
    labels_true = np.repeat([0, 1, 2], [10, 10, 5])
    labels = np.repeat([4, 7, 4, 7], [10, 6, 4, 5])  # predicted 7 covers true 1 best, and all of true 2
    assert match_parts(labels, labels_true) == {0: 4, 1: 7}


def test_points_of_no_true_part_match_nothing() -> None:
    labels_true = np.array([-1, -1, -1, 0, 1])
    assert match_parts(np.array([1, 1, 1, 0, 1]), labels_true) == {0: 0, 1: 1}
    assert match_parts(np.array([0, 1]), np.array([-1, -1])) == {}
