"""The flow stage: correspondences between consecutive frames and the motion that they imply (A.1).

An estimator is a function `(frames, config, rng, progress) -> list[PairFlow]`; `frames` are T arrays
(points, 3) in the normalised frame, and the answer holds one `PairFlow` for each consecutive pair.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from schemas.config import FlowConfig
from schemas.flow import Flow
from schemas.sequence import PointSequence
from stages.flow.descriptors import fpfh
from stages.flow.geometric import estimate_geometric
from stages.flow.hybrid import hybrid_of
from stages.flow.match import Estimator, matching_by
from stages.flow.network.describe import describe
from stages.flow.pair import PairFlow
from stages.progress import Progress, silent
from stages.registry import resolve


def estimate_none(
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    config: FlowConfig,
    rng: np.random.Generator,
    progress: Progress,
) -> list[PairFlow]:
    """No flow at all, to see what it brings: no matches in any pair."""
    nothing = np.zeros(0, dtype=np.int64)
    return [PairFlow(nothing, nothing, np.zeros((0, 3)), np.zeros(0)) for _ in frames[1:]]


ESTIMATORS: dict[str, Estimator] = {
    "geometric": estimate_geometric,
    "network": matching_by(describe),
    "hybrid": hybrid_of(describe, fpfh),
    "fpfh": matching_by(fpfh),
    "none": estimate_none,
}


def estimate_flow(
    sequence: PointSequence, config: FlowConfig, rng: np.random.Generator, progress: Progress = silent
) -> Flow:
    """Flow of every consecutive frame pair, by the estimator that the configuration names.

    Raises InputError for an unknown estimator, ValueError where a user's own returns the wrong number of
    pairs or indices outside a frame.
    """
    frames = sequence.frames()
    pairs = resolve("flow.estimator", config.estimator, ESTIMATORS)(frames, config, rng, progress)
    if len(pairs) != len(frames) - 1:
        raise ValueError(
            f"flow.estimator {config.estimator!r}: found {len(pairs)} pairs, expected {len(frames) - 1} "
            f"for {len(frames)} frames; return one PairFlow for each consecutive pair"
        )
    for k, pair in enumerate(pairs):
        for name, index, count in (
            ("source_index", pair.source_index, len(frames[k])),
            ("target_index", pair.target_index, len(frames[k + 1])),
        ):
            if len(index) and not 0 <= index.min() <= index.max() < count:
                raise ValueError(
                    f"flow.estimator {config.estimator!r}, pair {k}: {name} in {index.min()}..{index.max()}, "
                    f"expected 0..{count - 1}"
                )
    return Flow(
        match_counts=np.array([len(pair.source_index) for pair in pairs], dtype=np.int64),
        source_index=np.concatenate([pair.source_index for pair in pairs]),
        target_index=np.concatenate([pair.target_index for pair in pairs]),
        flow=np.concatenate([pair.flow for pair in pairs]),
        confidence=np.concatenate([pair.confidence for pair in pairs]),
    )
