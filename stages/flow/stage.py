"""The flow stage: correspondences between pairs of frames and the flow that they imply (A.1).

An estimator is a function `(frames, config, rng, progress) -> list[PairFlow]`. `frames` are T arrays (points, 3) in
the normalised frame. The result has one `PairFlow` for each consecutive pair.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float64

from schemas.config import FlowConfig
from schemas.flow import Flow
from schemas.sequence import PointSequence
from stages.flow.descriptors import fpfh
from stages.flow.geometric import estimate_geometric
from stages.flow.hybrid import hybrid_of
from stages.flow.likeness import matching_paths
from stages.flow.match import Estimator, matching_by
from stages.flow.network.describe import describe
from stages.flow.pair import PairFlow
from stages.flow.pair_cost import pair_cost
from stages.support.progress import Progress, silent
from stages.support.registry import blaming, resolve


def estimate_none(
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    config: FlowConfig,
    rng: np.random.Generator,
    progress: Progress,
) -> list[PairFlow]:
    """Return no matches for any pair, to measure the effect of flow."""
    nothing = np.zeros(0, dtype=np.int64)
    return [PairFlow(nothing, nothing, np.zeros((0, 3)), np.zeros(0)) for _ in frames[1:]]


ESTIMATORS: dict[str, Estimator] = {
    "geometric": estimate_geometric,
    "network": matching_by(describe),
    "hybrid": hybrid_of(describe, fpfh),
    "fpfh": matching_by(fpfh),
    "none": estimate_none,
}


def compute_flow(
    sequence: PointSequence,
    config: FlowConfig,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> Flow:
    """Estimate the flow of pairs of frames that look alike by the configured estimator, and judge each pair.

    Raises InputError for an unknown estimator, and ValueError if a user's own one does not return one PairFlow for each
    consecutive pair of the frames that it is given, or returns indices outside a frame.
    """
    frames = sequence.frames()
    pairs = _by_estimator(frames, config, rng, progress)
    with blaming("flow.estimator", config.estimator):
        flow = _assembled(pairs)
    costs = [pair_cost(frames[pair.source_frame], frames[pair.target_frame], pair) for pair in flow.pairs()]
    return flow.replace(pair_costs=np.array(costs))


def _by_estimator(
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    config: FlowConfig,
    rng: np.random.Generator,
    progress: Progress,
) -> list[tuple[int, int, PairFlow]]:
    """The flow of pairs of frames that look alike, as (source frame, target frame, flow)."""
    estimate = resolve("flow.estimator", config.estimator, ESTIMATORS)
    pairs = []
    for path in matching_paths(frames):
        found = estimate([frames[t] for t in path], config, rng, progress)
        if problem := next(_problems(found, [len(frames[t]) for t in path]), None):
            raise ValueError(f"flow.estimator {config.estimator!r}{problem}")
        pairs += [(a, b, pair) for (a, b), pair in zip(pairwise(path), found, strict=True)]
    return pairs


def _assembled(pairs: Sequence[tuple[int, int, PairFlow]]) -> Flow:
    """The artifact of some pairs, whose costs are yet to be found."""
    flows = [pair for _, _, pair in pairs]
    return Flow(
        pair_frames=np.array([(source, target) for source, target, _ in pairs], dtype=np.int64),
        pair_costs=np.zeros(len(pairs)),
        match_counts=np.array([len(pair.source_index) for pair in flows], dtype=np.int64),
        source_index=np.concatenate([pair.source_index for pair in flows]),
        target_index=np.concatenate([pair.target_index for pair in flows]),
        flow=np.concatenate([pair.flow for pair in flows]),
        confidence=np.concatenate([pair.confidence for pair in flows]),
    )


def _problems(pairs: Any, point_counts: Sequence[int]) -> Iterator[str]:
    """Yield the problems of an estimator's result for frames with the given numbers of points."""
    if not isinstance(pairs, Sequence) or len(pairs) != len(point_counts) - 1:
        found = f"{len(pairs)} pairs" if isinstance(pairs, Sequence) else f"a {type(pairs).__name__}"
        yield (
            f": found {found}, expected {len(point_counts) - 1} for {len(point_counts)} frames; "
            "return one PairFlow for each consecutive pair"
        )
    for k, pair in enumerate(pairs):
        if not isinstance(pair, PairFlow):
            yield f", pair {k}: found a {type(pair).__name__}, expected a PairFlow"
        columns = {name: np.shape(getattr(pair, name)) for name in ("source_index", "target_index", "confidence")}
        rows = len(pair.source_index) if columns["source_index"] else 0
        if set(columns.values()) != {(rows,)} or np.shape(pair.flow) != (rows, 3):
            yield f", pair {k}: found arrays of shapes {columns | {'flow': np.shape(pair.flow)}}, expected equal rows"
        for name, index, count in (
            ("source_index", pair.source_index, point_counts[k]),
            ("target_index", pair.target_index, point_counts[k + 1]),
        ):
            if len(index) and not 0 <= np.min(index) <= np.max(index) < count:
                yield f", pair {k}: {name} in {np.min(index)}..{np.max(index)}, expected 0..{count - 1}"
