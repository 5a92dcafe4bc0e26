"""What the flow stage writes."""

from __future__ import annotations

from typing import Annotated, NamedTuple, Self

import numpy as np
from jaxtyping import Float64, Int64
from pydantic import Field, model_validator

from schemas.artifact import GREATEST, Artifact, Unit, Within

LAST_INDEX = 2**53  # any index; the stage checks it against the frame that it points into


class FlowPair(NamedTuple):
    """The matches of one pair of frames, as views."""

    source_frame: int
    target_frame: int
    cost: float
    source_index: Int64[np.ndarray, "matches"]
    target_index: Int64[np.ndarray, "matches"]
    flow: Float64[np.ndarray, "matches 3"]
    confidence: Float64[np.ndarray, "matches"]


class Flow(Artifact):
    """Mutual correspondences between pairs of frames and the flow that they imply (A.1).

    The pairs connect all frames. Pair k links frame `pair_frames[k, 0]` to frame `pair_frames[k, 1]` and owns
    `match_counts[k]` consecutive rows of the other arrays. `flow` is the displacement of the surface at the source
    point. It differs from the difference of the two matched points, which were sampled independently and so carry
    sampling noise.
    """

    pair_frames: Annotated[Int64[np.ndarray, "pairs 2"], Unit("index"), Within(0, LAST_INDEX)] = Field(
        description="source and target frame of each pair"
    )
    pair_costs: Annotated[Float64[np.ndarray, "pairs"], Unit("1"), Within(0, GREATEST)] = Field(
        description="how badly the flow carries one frame to the other; the lower, the surer the pair"
    )
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

    def pairs(self) -> list[FlowPair]:
        """The pairs of frames with their matches."""
        ends = np.cumsum(self.match_counts)[:-1]
        columns = (self.source_index, self.target_index, self.flow, self.confidence)
        matches = zip(*(np.split(column, ends) for column in columns), strict=True)
        return [
            FlowPair(source, target, cost, *of_pair)
            for (source, target), cost, of_pair in zip(
                self.pair_frames.tolist(), self.pair_costs.tolist(), matches, strict=True
            )
        ]
