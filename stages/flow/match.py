"""Matches of two clouds by features of their points, and the estimators that use these matches alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64

from schemas.config import FlowConfig
from stages.flow.pair import PairFlow
from stages.kernels.points.nearest import KDTree
from stages.kernels.points.sampling import point_spacing, working_points
from stages.support.progress import Progress

Describe = Callable[[Float64[np.ndarray, "points 3"], FlowConfig], Float[np.ndarray, "points features"]]
Estimator = Callable[
    [Sequence[Float64[np.ndarray, "points 3"]], FlowConfig, np.random.Generator, Progress], list[PairFlow]
]

SAME_PLACE = 0.02, 2.0  # in diagonals or spacings: closer points count as one place, since each frame is sampled anew
COMPANY = 24  # nearby matches with which each match is compared
AROUND = 16  # most points at one place
MOST_POINTS = 4096  # of a frame to match, since the matching matrix grows with the square
CHUNK = 1024  # rows of the matching matrix held in memory at a time


@dataclass(frozen=True)
class Described:
    """Points of a cloud, in the normalised frame, with features. Dot products of features are logits of S(P) (A.1)."""

    p: Float64[np.ndarray, "points 3"]
    features: Float[np.ndarray, "points features"]

    @cached_property
    def same_place(self) -> float:
        """The distance up to which points count as the same place."""
        diagonals, spacings = SAME_PLACE
        return max(diagonals, spacings * point_spacing(self.p)) if len(self.p) > 1 else diagonals


@dataclass(frozen=True)
class Matches:
    """Matched points of a source and a target cloud, and the confidence of each match in [0, 1]."""

    source_index: Int64[np.ndarray, "matches"]
    target_index: Int64[np.ndarray, "matches"]
    confidence: Float64[np.ndarray, "matches"]

    def of(self, kept: Bool[np.ndarray, "matches"]) -> Matches:
        """The matches that are kept."""
        return Matches(self.source_index[kept], self.target_index[kept], self.confidence[kept])


def matching_by(describe: Describe) -> Estimator:
    """Make the estimator whose flow is the difference of matched points."""

    def estimate(
        frames: Sequence[Float64[np.ndarray, "points 3"]],
        config: FlowConfig,
        rng: np.random.Generator,
        progress: Progress,
    ) -> list[PairFlow]:
        chosen = [working_points(frame, MOST_POINTS) for frame in frames]
        thinned = [frame[index] for frame, index in zip(frames, chosen, strict=True)]
        described = [Described(p, describe(p, config)) for p in thinned]
        pairs = []
        for t, (source, target) in enumerate(pairwise(described)):
            matches = match_features(source, target)
            p_from, p_to = places(source, target, matches)
            kept = keep_distances(p_from, p_to, source.same_place / 2)
            matches, flow = matches.of(kept), (p_to - p_from)[kept]
            index, target_index = chosen[t][matches.source_index], chosen[t + 1][matches.target_index]
            pairs.append(PairFlow(index, target_index, flow, matches.confidence))
            progress(t + 1, len(frames) - 1)
        return pairs

    return estimate


def keep_distances(
    p_from: Float64[np.ndarray, "matches 3"], p_to: Float64[np.ndarray, "matches 3"], tolerance: float
) -> Bool[np.ndarray, "matches"]:
    """Which matches keep their distances, up to `tolerance`, to half of the nearby matches, as on a rigid part."""
    if len(p_from) == 0:
        return np.zeros(0, dtype=bool)
    count = min(COMPANY + 1, len(p_from))
    near = KDTree(p_from).query(p_from, k=count)[1].reshape(len(p_from), count).astype(np.int64)
    before, after = (np.linalg.norm(p[near] - p[:, None], axis=-1) for p in (p_from, p_to))
    kept: np.ndarray = np.median(np.abs(after - before), axis=1) <= tolerance
    return kept


def places(
    source: Described, target: Described, matches: Matches
) -> tuple[Float64[np.ndarray, "matches 3"], Float64[np.ndarray, "matches 3"]]:
    """The positions of the matched points in the source and in the target."""
    return source.p[matches.source_index], target.p[matches.target_index]


def match_features(source: Described, target: Described) -> Matches:
    """Match each source point to its likeliest target point, if the likeliest point back is at the same place.

    Requiring the very same point would be too strict: even under the true motion only half of two clouds' points are
    mutual nearest neighbours. The confidence is the total probability of the target points at the matched place.
    """
    if len(source.p) == 0 or len(target.p) == 0:
        nothing = np.zeros(0, dtype=np.int64)
        return Matches(nothing, nothing, np.zeros(0))
    around = _around(target)
    rows = [slice(start, start + CHUNK) for start in range(0, len(source.p), CHUNK)]
    forward, confidence = (
        np.concatenate(found) for found in zip(*(_likeliest(source, target, around, r) for r in rows), strict=True)
    )
    backward = np.concatenate(
        [
            (target.features[start : start + CHUNK] @ source.features.T).argmax(axis=1)
            for start in range(0, len(target.p), CHUNK)
        ]
    )
    back = np.linalg.norm(source.p[backward[forward]] - source.p, axis=1)
    kept = np.flatnonzero(back <= source.same_place)
    return Matches(kept, forward[kept], confidence[kept].astype(np.float64))


def _around(cloud: Described) -> Int64[np.ndarray, "points around"]:
    """The points at the same place as each point, itself first. The number of points fills rows with fewer."""
    count = min(AROUND, len(cloud.p))
    near = KDTree(cloud.p).query(cloud.p, k=count, distance_upper_bound=cloud.same_place)[1]
    return near.reshape(len(cloud.p), count).astype(np.int64)


def _likeliest(
    source: Described, target: Described, around: Int64[np.ndarray, "targets around"], rows: slice
) -> tuple[Int64[np.ndarray, "rows"], Float32[np.ndarray, "rows"]]:
    """The likeliest target point of each row, and the total probability of the points at its place."""
    logits = source.features[rows] @ target.features.T
    chosen = logits.argmax(axis=1)
    probability = np.exp(logits - logits.max(axis=1, keepdims=True))
    probability /= probability.sum(axis=1, keepdims=True)
    padded = np.column_stack([probability, np.zeros(len(chosen))])
    return chosen, np.minimum(np.take_along_axis(padded, around[chosen], axis=1).sum(axis=1), 1.0)
