"""Where the relaxed fit starts: parts and motions read off the flow, or none at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.motion.rigid_clustering import merge_rigid_clusters, moments, rigid_motion
from stages.kernels.points.nearest import FEW_NEIGHBOURS, KDTree, nearest, neighbours
from stages.kernels.points.sampling import farthest_points

SEEDS_PER_PART = 12


@dataclass(frozen=True)
class Start:
    """Labels of some canonical points and a motion for every part and frame."""

    labels: Int64[np.ndarray, "points"]
    Ts_frame_canonical: Float64[np.ndarray, "frames parts 4 4"]


def start_from_flow(
    p_canonical: Float64[np.ndarray, "points 3"],
    trajectories: Float64[np.ndarray, "frames points 3"],
    max_parts: int,
) -> Start:
    """Cluster the points' trajectories along the flow into at most `max_parts` rigid parts.

    Small patches of the surface merge greedily, touching ones only, at the price of the sum of squares
    that their union adds.
    """
    seeds = farthest_points(p_canonical, min(SEEDS_PER_PART * max_parts, max(1, len(p_canonical) // 6)))
    patch = nearest(KDTree(p_canonical[seeds]), p_canonical)[1]
    near = neighbours(p_canonical, FEW_NEIGHBOURS)[1]
    touching = np.stack([patch[np.arange(len(patch)).repeat(near.shape[1])], patch[near.ravel()]], axis=1)
    patches = moments(p_canonical, trajectories, patch, len(seeds))
    merged = merge_rigid_clusters(patches, np.unique(touching, axis=0), max_parts)
    labels = merged[patch]
    motions = rigid_motion(moments(p_canonical, trajectories, labels, labels.max() + 1))
    return Start(labels, motions.transpose(1, 0, 2, 3))
