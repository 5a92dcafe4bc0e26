"""What the flow stage writes."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from jaxtyping import Float64, Int64
from pydantic import model_validator

from schemas.artifact import Artifact, Unit, Within

LAST_INDEX = 2**53  # any index; the stage checks it against the frame that it points into


class Flow(Artifact):
    """Mutual correspondences between consecutive frames and the flow that they imply (A.1).

    Pair k links frame k to frame k + 1 and owns `match_counts[k]` consecutive rows of the other arrays.
    `flow` is the displacement of the surface at the source point. It differs from the difference of the two matched
    points, which were sampled independently and so carry sampling noise.
    """

    match_counts: Annotated[Int64[np.ndarray, "pairs"], Unit("count"), Within(0, LAST_INDEX)]
    source_index: Annotated[Int64[np.ndarray, "matches"], Unit("index"), Within(0, LAST_INDEX)]
    target_index: Annotated[Int64[np.ndarray, "matches"], Unit("index"), Within(0, LAST_INDEX)]
    flow: Annotated[Float64[np.ndarray, "matches 3"], Unit("normalised")]
    confidence: Annotated[Float64[np.ndarray, "matches"], Unit("1"), Within(0, 1)]

    @model_validator(mode="after")
    def _check_counts(self) -> Self:
        if (total := sum(self.match_counts.tolist())) != len(self.source_index):
            raise ValueError(f"Flow.match_counts: found a sum of {total}, expected {len(self.source_index)} matches")
        return self

    def pairs(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """(source_index, target_index, flow, confidence) of each frame pair, as views."""
        ends = np.cumsum(self.match_counts)[:-1]
        columns = (self.source_index, self.target_index, self.flow, self.confidence)
        return list(zip(*(np.split(column, ends) for column in columns), strict=True))
