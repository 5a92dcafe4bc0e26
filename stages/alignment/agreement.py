"""The choice of one motion for each frame such that it is the same body that all of them move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

SEEDS, ROUNDS = 4, 4
SHARE_WEIGHT = 0.5  # of the motions' own shares beside that of the common body


def agreeing(
    explained: Sequence[Float64[np.ndarray, "motions points"]], shares: Sequence[Float64[np.ndarray, "motions"]]
) -> list[int]:
    """The number of the chosen motion of each frame.

    `explained` says how well each motion explains each point of the reference frame, from 0 to 1. Several bodies may be
    the largest one in some frames. So each frame's best motions are taken as seeds: in the other frames the motion is
    chosen that best explains the points which are explained so far.
    """
    best, chosen = -np.inf, [0] * len(explained)
    for seed in (one[k] for one in explained for k in range(min(SEEDS, len(one)))):
        common = seed
        for _ in range(ROUNDS):
            numbers = [int((one @ common).argmax()) for one in explained]
            common = np.mean([one[k] for one, k in zip(explained, numbers, strict=True)], axis=0) ** 2
        own = np.mean([one[k] for one, k in zip(shares, numbers, strict=True)])
        if (score := float(common.mean() + SHARE_WEIGHT * own)) > best:
            best, chosen = score, numbers
    return chosen
