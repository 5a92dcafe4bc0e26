"""The flow stage: correspondences between pairs of frames and the flow that they imply (A.1).

An estimator is a function `(frames, config, rng, progress) -> list[PairFlow]`. `frames` are T arrays (points, 3) in
the normalised frame. The result has one `PairFlow` for each consecutive pair.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float64

from schemas.config import BodiesFlowConfig, FlowConfig
from schemas.flow import Flow
from schemas.sequence import PointSequence
from stages.flow.bodies.estimator import flow_by_bodies
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

FARTHEST = 98  # percentile of the flow's lengths that tells how far points move


def estimate_none(
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    config: FlowConfig,
    rng: np.random.Generator,
    progress: Progress,
) -> list[PairFlow]:
    """Return no matches for any pair, to measure the effect of flow. Set `flow.bodies.most_frames=0` as well."""
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
    reference: int | None = None,
) -> Flow:
    """Estimate the flow of pairs of frames that look alike by the configured estimator, and judge each pair.

    Where frames are few or far apart, the flow from the `reference` frame (by default the middle one) to all others is
    also looked for by rigid bodies.

    Raises InputError for an unknown estimator, and ValueError if a user's own one does not return one PairFlow for each
    consecutive pair of the frames that it is given, or returns indices outside a frame.
    """
    frames = sequence.frames()
    pairs = _by_estimator(frames, config, rng, progress)
    if _far_apart(pairs, len(frames), config.bodies):
        pairs += _by_bodies(frames, len(frames) // 2 if reference is None else reference, config)
    with blaming("flow.estimator", config.estimator):
        return Flow(
            pair_frames=np.array([(pair.source_frame, pair.target_frame) for pair in pairs], dtype=np.int64),
            pair_costs=np.array([pair.cost for pair in pairs]),
            match_counts=np.array([len(pair.flow.source_index) for pair in pairs], dtype=np.int64),
            source_index=np.concatenate([pair.flow.source_index for pair in pairs]),
            target_index=np.concatenate([pair.flow.target_index for pair in pairs]),
            flow=np.concatenate([pair.flow.flow for pair in pairs]),
            confidence=np.concatenate([pair.flow.confidence for pair in pairs]),
        )


@dataclass(frozen=True)
class _JudgedPair:
    """The flow of a pair of frames, and how badly it carries one to the other."""

    source_frame: int
    target_frame: int
    flow: PairFlow
    cost: float


def _by_estimator(
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    config: FlowConfig,
    rng: np.random.Generator,
    progress: Progress,
) -> list[_JudgedPair]:
    """The flow of pairs that look alike."""
    estimate = resolve("flow.estimator", config.estimator, ESTIMATORS)
    judged = []
    for path in matching_paths(frames):
        found = estimate([frames[t] for t in path], config, rng, progress)
        if problem := next(_problems(found, [len(frames[t]) for t in path]), None):
            raise ValueError(f"flow.estimator {config.estimator!r}{problem}")
        judged += [
            _JudgedPair(a, b, flow, pair_cost(frames[a], frames[b], flow))
            for (a, b), flow in zip(pairwise(path), found, strict=True)
        ]
    return judged


def _far_apart(pairs: Sequence[_JudgedPair], frames: int, config: BodiesFlowConfig) -> bool:
    """Whether bodies are to be looked for: in few frames always, in some where points move far."""
    if config.few_frames < frames <= config.most_frames:
        lengths = [np.linalg.norm(pair.flow.flow, axis=1) for pair in pairs if len(pair.flow.flow)]
        return bool(lengths) and np.mean([np.percentile(length, FARTHEST) for length in lengths]) > config.far
    return frames <= config.few_frames


def _by_bodies(
    frames: Sequence[Float64[np.ndarray, "points 3"]], reference: int, config: FlowConfig
) -> list[_JudgedPair]:
    """The flow from the reference frame to all others."""
    return [
        _JudgedPair(
            reference, t, flow, max(0.0, pair_cost(frames[reference], frames[t], flow) - config.bodies.advantage)
        )
        for t, flow in flow_by_bodies(frames, reference, config.bodies).items()
    ]


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
