"""Which part of one segmentation is which of another."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int64
from scipy.optimize import linear_sum_assignment


def match_parts(labels: Int64[np.ndarray, "points"], labels_true: Int64[np.ndarray, "points"]) -> dict[int, int]:
    """The predicted part of each true part, one to one, such that most points are in matched parts.

    Points with a negative true label belong to no part.
    """
    known = labels_true >= 0
    overlap = np.zeros((labels_true.max(initial=-1) + 1, labels.max() + 1), dtype=np.int64)
    np.add.at(overlap, (labels_true[known], labels[known]), 1)
    pairs = zip(*(index.tolist() for index in linear_sum_assignment(-overlap)), strict=True)
    return {true: predicted for true, predicted in pairs if overlap[true, predicted] > 0}
