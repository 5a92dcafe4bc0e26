"""Merging: linked parts that move alike become one (A.3)."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float64, Int64

from schemas.config import MergingConfig, ProjectionConfig
from schemas.kinematic import KinematicModel
from schemas.sequence import PointSequence
from stages.kernels import se3
from stages.kernels.rigid_clustering import Moments, moments, rigid_motion, rigid_residual
from stages.kernels.sampling import spacing
from stages.projection import link_parts


def merge(
    model: KinematicModel, sequence: PointSequence, config: MergingConfig, projection: ProjectionConfig
) -> KinematicModel:
    """Merge linked parts, nearest in space first, until every E_merge >= the threshold; then link anew.

    A merged part moves by the one rigid motion that best agrees with both parts' own.
    """
    p_canonical = sequence.frames()[model.canonical_frame]
    trajectories = se3.transform(
        torch.from_numpy(model.Ts_frame_canonical[:, model.labels]), torch.from_numpy(p_canonical)[:, None]
    )[..., 0, :].numpy()
    parts = moments(p_canonical, trajectories, model.labels, model.part_count)
    threshold = config.threshold * spacing(p_canonical)
    groups = merge_linked(parts, model.joint_parent, model.joint_child, model.e_spatial, threshold)
    labels = groups[model.labels]
    merged = moments(p_canonical, trajectories, labels, groups.max() + 1)
    Ts = rigid_motion(merged).transpose(1, 0, 2, 3)
    return link_parts(p_canonical, labels, np.ascontiguousarray(Ts), model.canonical_frame, projection)


def merge_energy(a: Moments, b: Moments) -> float:
    """E_merge: RMS distance that one common motion would leave, per point of the smaller part.

    The common motion is refitted to both parts in every frame before it is judged; two parts that move
    as one leave zero.
    """
    frames = a.y.shape[0]
    smaller = min(float(a.count), float(b.count))
    return float(np.sqrt(rigid_residual(a + b) / (frames * smaller)))


def merge_linked(
    parts: Moments,
    parent: Int64[np.ndarray, "joints"],
    child: Int64[np.ndarray, "joints"],
    e_spatial: Float64[np.ndarray, "joints"],
    threshold: float,
) -> Int64[np.ndarray, "parts"]:
    """The new part of each old part, 0..n-1."""
    groups = np.arange(len(parts.count))
    group_moments = {part: parts[part] for part in range(len(parts.count))}
    merged = True
    while merged:
        merged = False
        for joint in np.argsort(e_spatial, kind="stable"):
            a, b = int(groups[parent[joint]]), int(groups[child[joint]])
            if a != b and merge_energy(group_moments[a], group_moments[b]) < threshold:
                group_moments[a] = group_moments[a] + group_moments.pop(b)
                groups[groups == b] = a
                merged = True
                break  # the merged part's energies have changed: look again, nearest first
    return np.unique(groups, return_inverse=True)[1].astype(np.int64)
