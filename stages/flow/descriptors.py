"""A descriptor that needs no training, to measure the network by."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from schemas.config import FlowConfig
from stages.kernels.points.sampling import point_spacing
from stages.kernels.surfaces.open3d_library import load_open3d
from stages.support.open3d_use import needing_open3d

NORMAL_NEIGHBOURS = 16
SHARPNESS = 100.0  # of the matching matrix
RADIUS, MOST_NEIGHBOURS = 12.0, 200  # of the neighbourhood that is described, in spacings and points


@needing_open3d("flow.estimator fpfh or hybrid")
def fpfh(points: Float64[np.ndarray, "points 3"], config: FlowConfig) -> Float64[np.ndarray, "points 33"]:
    """Fast point feature histograms: angles between a neighbourhood's normals, which do not turn with the cloud.

    Features have the same length, of square roots of shares, so that the greatest dot product is the nearest in
    Hellinger's sense. `config` is not looked at.
    """
    o3d = load_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NORMAL_NEIGHBOURS))
    cloud.orient_normals_towards_camera_location(points.mean(axis=0))
    search = o3d.geometry.KDTreeSearchParamHybrid(radius=RADIUS * point_spacing(points), max_nn=MOST_NEIGHBOURS)
    features = np.asarray(o3d.pipelines.registration.compute_fpfh_feature(cloud, search).data).T
    features = np.sqrt(np.maximum(features, 0.0))
    return SHARPNESS**0.5 * features / (np.linalg.norm(features, axis=1, keepdims=True) + 1e-12)
