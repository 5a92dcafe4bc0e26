"""What the flow stage writes."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float64, Int64

from schemas.artifact import Artifact, Unit


class Flow(Artifact):
    """Mutual correspondences between consecutive frames and the motion that they imply (A.1).

    Pair k links frame k to frame k + 1 and owns `match_counts[k]` consecutive rows of the other arrays.
    `flow` is the displacement of the source point's piece of surface: the two matched points lie on the
    same surface but were sampled independently, so their plain difference carries the sampling noise.
    """

    match_counts: Annotated[Int64[np.ndarray, "pairs"], Unit("count")]
    source_index: Annotated[Int64[np.ndarray, "matches"], Unit("index")]
    target_index: Annotated[Int64[np.ndarray, "matches"], Unit("index")]
    flow: Annotated[Float64[np.ndarray, "matches 3"], Unit("normalised")]
    confidence: Annotated[Float64[np.ndarray, "matches"], Unit("1")]

    def pairs(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """(source_index, target_index, flow, confidence) of each frame pair, as views."""
        ends = np.cumsum(self.match_counts)[:-1]
        columns = (self.source_index, self.target_index, self.flow, self.confidence)
        return list(zip(*(np.split(column, ends) for column in columns), strict=True))
