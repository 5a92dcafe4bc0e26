"""How badly the flow of a pair carries one frame to the other, whatever the estimator."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from schemas.flow import FlowPair
from stages.flow.trajectories import interpolate
from stages.kernels.alignment.fit_cost import fit_costs
from stages.kernels.alignment.oriented_cloud import OrientedCloud
from stages.kernels.points.nearest import KDTree
from stages.kernels.points.sampling import point_spacing, working_points

POINTS = 1024
FLOW_NEIGHBOURS = 3
NO_MATCHES = 2.0  # the cost of a pair that nothing links


def pair_cost(
    source: Float64[np.ndarray, "points 3"], target: Float64[np.ndarray, "targets 3"], pair: FlowPair
) -> float:
    """The mean cost of the source's points once they are moved along the flow, plus that of the target's points."""
    if len(pair.source_index) == 0:
        return NO_MATCHES
    p = source[working_points(source, POINTS)]
    spacing = point_spacing(p)
    motion = interpolate(KDTree(source[pair.source_index]), pair.flow, p, FLOW_NEIGHBOURS)[0]
    moved = OrientedCloud.of((p + motion) / spacing)
    there = OrientedCloud.of(target[working_points(target, 2 * POINTS)] / spacing)
    still = np.eye(4)[None]
    return float(fit_costs(there, moved, still)[0].mean() + fit_costs(moved, there, still)[0].mean())
