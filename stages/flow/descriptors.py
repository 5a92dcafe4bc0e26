"""A descriptor without training, as a baseline for the network."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from schemas.config import FlowConfig
from stages.kernels.points.sampling import point_spacing
from stages.kernels.surfaces.open3d_library import load_open3d
from stages.support.open3d_use import needing_open3d

NORMAL_NEIGHBOURS = 16
SHARPNESS = 100.0  # of the matching matrix
RADIUS, MOST_NEIGHBOURS = 12.0, 200  # of the described neighbourhood, in spacings and points


@needing_open3d("flow.estimator fpfh or hybrid")
def fpfh(points: Float64[np.ndarray, "points 3"], config: FlowConfig) -> Float64[np.ndarray, "points 33"]:
    """Fast point feature histograms: angles between a neighbourhood's normals, which rotations do not change.

    Features are square roots of shares, with equal norms, so that the largest dot product has the smallest Hellinger
    distance. `config` is unused.
    """
    o3d = load_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NORMAL_NEIGHBOURS))
    cloud.orient_normals_towards_camera_location(points.mean(axis=0))
    search = o3d.geometry.KDTreeSearchParamHybrid(radius=RADIUS * point_spacing(points), max_nn=MOST_NEIGHBOURS)
    features = np.asarray(o3d.pipelines.registration.compute_fpfh_feature(cloud, search).data).T
    features = np.sqrt(np.maximum(features, 0.0))
    return SHARPNESS**0.5 * features / (np.linalg.norm(features, axis=1, keepdims=True) + 1e-12)
