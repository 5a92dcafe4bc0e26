"""How well a score tells two classes apart."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64


def area_under_roc(score: Float64[np.ndarray, "entries"], positive: Bool[np.ndarray, "entries"]) -> float | None:
    """The chance that a positive entry scores higher than a negative one, ties counting half; None without either.

    The area under the receiver operating characteristic: 1 where the score tells them apart, 0.5 where by chance.
    """
    if positive.all() or not positive.any():
        return None
    difference = score[positive][:, None] - score[~positive]
    return float(np.mean(0.5 * (np.sign(difference) + 1)))
