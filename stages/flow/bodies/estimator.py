"""The flow from one frame to all others by rigid bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from schemas.config import BodiesFlowConfig
from stages.flow.bodies.scene import Explanation, Scene
from stages.flow.bodies.search import explain
from stages.flow.pair import PairFlow, mutual_matches
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import nearest
from stages.kernels.points.sampling import farthest_points, point_spacing, working_points
from stages.kernels.surfaces.oriented_cloud import OrientedCloud

MAX_DISTANCE = 2.0  # spacings between matched points


def flow_by_bodies(
    frames: Sequence[Float64[np.ndarray, "points 3"]], reference: int, config: BodiesFlowConfig
) -> list[tuple[int, int, PairFlow]]:
    """The flow from the reference frame to each other frame, as (source frame, target frame, flow).

    One body stands still, as in common coordinates.
    """
    p = frames[reference]
    others = [t for t in range(len(frames)) if t != reference]
    index = working_points(p, config.points)
    spacing = point_spacing(p[index])
    working = [OrientedCloud.of(frames[t][working_points(frames[t], 2 * config.points)] / spacing) for t in others]
    source = OrientedCloud.of(p[working_points(p, 2 * config.points)] / spacing)
    source = source.take(farthest_points(source.p, config.points))
    still = np.tile(np.eye(4), (len(others), 1, 1))
    diagonal = float(np.linalg.norm(np.ptp(source.p, axis=0)))
    found = explain(Explanation.by_one_body(Scene.of(source, working), still), diagonal)
    label = found.labels[nearest(source.tree, p / spacing)[1]]
    pairs = []
    for k, t in enumerate(others):
        moved = move_points(found.Ts[label, k], p / spacing) * spacing
        pairs.append((reference, t, mutual_matches(p, moved, frames[t], point_spacing(frames[t]), MAX_DISTANCE)))
    return pairs
