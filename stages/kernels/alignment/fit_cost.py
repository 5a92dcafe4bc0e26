"""How badly a moved surface fits a cloud, and rigid motions that make it fit.

Lengths are in spacings of the clouds. Every function takes a batch of motions of the same points at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.alignment.oriented_cloud import OrientedCloud
from stages.kernels.alignment.registration import robust_weight, turn_about, twist_jacobian
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import nearest

PLANE_SPREAD, POINT_SPREAD = 0.35, 0.7  # of distances from a plane and between points, in spacings
BEND_SPREAD = 0.15  # of 1 - |cos| of the angle between the normals of flat surfaces
TRUNCATION = 9.0  # squared spreads at which the cost is one
POINT_TO_POINT = 0.1
DAMPING = 1e-4


def fit_costs(
    target: OrientedCloud, source: OrientedCloud, Ts: Float64[np.ndarray, "motions 4 4"]
) -> tuple[Float64[np.ndarray, "motions points"], Int64[np.ndarray, "motions points"]]:
    """The cost in [0, 1] of each source point under each motion, and the target point nearest to it.

    On flat surfaces the distance from the plane counts most, since points of two clouds never coincide. A flat source
    on a flat target must have its normal, too.
    """
    p = move_points(Ts[:, None], source.p)
    distance, index = nearest(target.tree, p.reshape(-1, 3))
    distance, index = distance.reshape(p.shape[:2]), index.reshape(p.shape[:2])
    normals, flatness = target.normals[index], target.flatness[index]
    plane = np.einsum("mni,mni->mn", p - target.p[index], normals)
    cosine = np.einsum("mni,mni->mn", np.matmul(source.normals, Ts[:, :3, :3].transpose(0, 2, 1)), normals)
    flat = flatness**2
    squared = (
        flat * (plane / PLANE_SPREAD) ** 2
        + (1.0 - flat) * (distance / POINT_SPREAD) ** 2
        + distance**2
        + (flatness * source.flatness * (1.0 - np.abs(cosine)) / BEND_SPREAD) ** 2
    )
    return np.minimum(1.0, squared / TRUNCATION), index


def refine_motions(
    target: OrientedCloud,
    source: OrientedCloud,
    Ts: Float64[np.ndarray, "motions 4 4"],
    reaches: Sequence[float],
    target_weights: Float64[np.ndarray, "targets"] | None = None,
) -> Float64[np.ndarray, "motions 4 4"]:
    """Improve each motion by itself: Gauss-Newton on robust plane distances, one step for each reach.

    A match counts by `target_weights` of its target, which are one by default. Matches of flat surfaces count less the
    more their normals differ, and matches much farther apart than the reach hardly count.
    """
    centre = source.p.mean(axis=0)
    for reach in reaches:
        p = move_points(Ts[:, None], source.p)
        distance, index = nearest(target.tree, p.reshape(-1, 3))
        distance, index = distance.reshape(p.shape[:2]), index.reshape(p.shape[:2])
        normals, flatness = target.normals[index], target.flatness[index]
        offsets = p - target.p[index]
        cosine = np.einsum("mni,mni->mn", np.matmul(source.normals, Ts[:, :3, :3].transpose(0, 2, 1)), normals)
        both_flat = flatness * source.flatness
        weights = robust_weight(distance, reach) * (1.0 - both_flat * (1.0 - cosine**4))
        if target_weights is not None:
            weights = weights * target_weights[index]
        centres = move_points(Ts, centre)
        arms = p - centres[:, None]
        plane_jacobian = np.concatenate([np.cross(arms, normals), normals], axis=-1)
        plane_weights = weights * flatness**2
        planes = np.einsum("mni,mni->mn", offsets, normals)
        hessian = np.matmul((plane_weights[..., None] * plane_jacobian).transpose(0, 2, 1), plane_jacobian)
        gradient = np.einsum("mna,mn->ma", plane_jacobian, plane_weights * planes)
        jacobian = twist_jacobian(arms).reshape(len(Ts), -1, 6)
        point_weights = np.repeat(weights * (POINT_TO_POINT + (1.0 - POINT_TO_POINT) * (1.0 - flatness**2)), 3, axis=1)
        hessian += np.matmul((point_weights[..., None] * jacobian).transpose(0, 2, 1), jacobian)
        gradient += np.einsum("mka,mk->ma", jacobian, point_weights * offsets.reshape(len(Ts), -1))
        scale = 1e-3 + DAMPING * np.trace(hessian, axis1=1, axis2=2) / 6
        twists = -np.linalg.solve(hessian + scale[:, None, None] * np.eye(6), gradient[..., None])[..., 0]
        Ts = turn_about(centres, twists, 1.0) @ Ts
    return Ts
