"""Descriptors that need no training, and the estimator `fpfh` that matches by nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64

from schemas.config import FlowConfig
from stages.flow.match import mutual_nearest
from stages.flow.pair import PairFlow
from stages.kernels.sampling import spacing
from stages.progress import Progress

NORMAL_NEIGHBOURS = 16
RADIUS, MOST_NEIGHBOURS = 12.0, 200  # of the neighbourhood that is described, in spacings and points


def fpfh(points: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 33"]:
    """Fast point feature histograms: angles between a neighbourhood's normals, which do not turn with the cloud.

    Features have unit length and, over the cloud, mean zero before, so that their dot product tells what differs.
    """
    import open3d as o3d  # takes a second

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NORMAL_NEIGHBOURS))
    cloud.orient_normals_towards_camera_location(points.mean(axis=0))
    search = o3d.geometry.KDTreeSearchParamHybrid(radius=RADIUS * spacing(points), max_nn=MOST_NEIGHBOURS)
    registration: Any = o3d.pipelines.registration  # its stubs want an argument that may be left out
    features = np.asarray(registration.compute_fpfh_feature(cloud, search).data).T
    features = np.sqrt(np.maximum(features, 0.0))
    return features / (np.linalg.norm(features, axis=1, keepdims=True) + 1e-12)


def estimate_fpfh(
    frames: Sequence[Float64[np.ndarray, "points 3"]],
    config: FlowConfig,
    rng: np.random.Generator,
    progress: Progress,
) -> list[PairFlow]:
    """Mutually nearest descriptors of each consecutive pair of frames; the flow is the matched points' difference."""
    features = [fpfh(frame) for frame in frames]
    pairs = []
    for t in range(len(frames) - 1):
        matches = mutual_nearest(features[t], features[t + 1])
        flow = frames[t + 1][matches.target_index] - frames[t][matches.source_index]
        pairs.append(PairFlow(matches.source_index, matches.target_index, flow, matches.confidence))
        progress(t + 1, len(frames) - 1)
    return pairs
