"""Merging: parts that touch and move alike become one (A.3)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64

from schemas.config import MergingConfig, ProjectionConfig
from schemas.kinematic import KinematicModel
from schemas.sequence import PointSequence
from stages.kernels.motion.rigid_clustering import Moments, moments, rigid_motion, rigid_square_sum
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import SURFACE_NEIGHBOURS, neighbours
from stages.kernels.points.sampling import point_spacing
from stages.projection.stage import link_parts, spatial_energies

TOUCHING_PAIRS = 5  # pairs of neighbouring points that two parts share, from which on they touch


def compute_merging(
    model: KinematicModel, sequence: PointSequence, config: MergingConfig, projection: ProjectionConfig
) -> KinematicModel:
    """Merge parts that are linked or touch, nearest in space first, until every E_merge >= the threshold; none at zero.

    A tree links each part to few others, so pieces of one body may hang on different neighbours: touching
    parts are looked at too. A merged part moves by the one rigid motion that best agrees with both; the
    tree is then found anew.
    """
    if config.threshold == 0:
        return model
    p_canonical = sequence.frames()[model.canonical_frame]
    trajectories = move_points(model.Ts_frame_canonical[:, model.labels], p_canonical)
    parts = moments(p_canonical, trajectories, model.labels, model.part_count)
    links = np.stack([model.joint_parent, model.joint_child], axis=1)
    pairs = np.concatenate([links, touching_parts(p_canonical, model.labels)])
    apart = spatial_energies(p_canonical, model.labels, 0.0)
    nearest_first = pairs[np.argsort(apart[pairs[:, 0], pairs[:, 1]], kind="stable")]
    groups = merge_alike(parts, nearest_first, config.threshold * point_spacing(p_canonical))
    labels = groups[model.labels]
    merged = moments(p_canonical, trajectories, labels, groups.max() + 1)
    Ts = np.ascontiguousarray(rigid_motion(merged).transpose(1, 0, 2, 3))
    for group in range(Ts.shape[1]):
        members = np.flatnonzero(groups == group)
        if len(members) == 1:  # a motion cannot be read off a part of one or two points
            Ts[:, group] = model.Ts_frame_canonical[:, members[0]]
    Ts[model.canonical_frame] = np.eye(4)
    return link_parts(p_canonical, labels, Ts, model.canonical_frame, projection)


def touching_parts(
    p: Float64[np.ndarray, "points 3"], labels: Int64[np.ndarray, "points"]
) -> Int64[np.ndarray, "pairs 2"]:
    """Pairs of parts, smaller number first, whose points are neighbours in several places."""
    near = labels[neighbours(p, SURFACE_NEIGHBOURS)[1]]
    crossings = np.stack([np.minimum(labels[:, None], near), np.maximum(labels[:, None], near)], axis=-1)
    pairs, counts = np.unique(crossings.reshape(-1, 2), axis=0, return_counts=True)
    return pairs[(pairs[:, 0] != pairs[:, 1]) & (counts >= TOUCHING_PAIRS)]


def merge_energy(a: Moments, b: Moments) -> float:
    """E_merge: RMS distance that one common motion would leave, per point of the smaller part.

    The common motion is refitted to both parts in every frame before it is judged; two parts that move
    as one leave zero.
    """
    frames = a.y.shape[0]
    smaller = min(float(a.count), float(b.count))
    return float(np.sqrt(rigid_square_sum(a + b) / (frames * smaller)))


def merge_alike(parts: Moments, pairs: Int64[np.ndarray, "pairs 2"], threshold: float) -> Int64[np.ndarray, "parts"]:
    """The new part of each old part, 0..n-1, when the first pair below the threshold merges, again and again."""
    groups = np.arange(len(parts.count))
    group_moments = {part: parts[part] for part in range(len(parts.count))}
    merged = True
    while merged:
        merged = False
        for a, b in groups[pairs]:
            if a != b and merge_energy(group_moments[a], group_moments[b]) < threshold:
                group_moments[a] = group_moments[a] + group_moments.pop(b)
                groups[groups == b] = a
                merged = True
                break  # the merged part's energies have changed: look again from the first pair on
    return np.unique(groups, return_inverse=True)[1].astype(np.int64)
