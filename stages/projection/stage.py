"""Projection: the relaxed model's parts linked to a kinematic tree of screw joints (Eq. 11, A.2)."""

from __future__ import annotations

from itertools import combinations
from typing import cast

import networkx as nx
import numpy as np
from jaxtyping import Float64, Int64

from schemas.config import ProjectionConfig
from schemas.joints import SCREW, JointKind
from schemas.kinematic import KinematicModel
from schemas.relaxed import RelaxedModel
from schemas.sequence import PointSequence
from stages.kernels.kinematics.closed_form import JointFit, fit_joint
from stages.kernels.motion.rigid_motion import inverse, move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points, point_spacing

LOWEST = 2  # percentile of a part's heights that counts as its lowest point


def compute_projection(relaxed: RelaxedModel, sequence: PointSequence, config: ProjectionConfig) -> KinematicModel:
    """The tree that minimises l_spatial E_spatial + l_1DOF E_1DOF, with a screw for each link (Eq. 11)."""
    p_canonical = sequence.frames()[relaxed.canonical_frame]
    return link_parts(p_canonical, relaxed.labels, relaxed.Ts_frame_canonical, relaxed.canonical_frame, config)


def link_parts(
    p_canonical: Float64[np.ndarray, "points 3"],
    labels: Int64[np.ndarray, "points"],
    Ts_frame_canonical: Float64[np.ndarray, "frames parts 4 4"],
    canonical_frame: int,
    config: ProjectionConfig,
) -> KinematicModel:
    """Link labelled parts with known motions."""
    samples = part_samples(p_canonical, labels, config.samples_per_part)
    spacing = point_spacing(p_canonical)
    spatial = spatial_energies(p_canonical, labels, config.contact * spacing)
    fits = relative_joints(SCREW, samples, Ts_frame_canonical)
    rotating = [kind for kind in config.kinds if kind.is_ball]
    left = relative_joints(rotating[0], samples, Ts_frame_canonical).mean_square if rotating else fits.mean_square
    # the pair's energy must not depend on which of the two is called the child
    one_dof = 0.5 * (left + left.T)
    tree = spanning_tree(config.lambda_spatial * spatial + config.lambda_1dof * one_dof)
    sizes = np.bincount(labels)
    if config.root == "middle":
        root = middle_part(tree, sizes)
    elif config.root == "ground":
        root = standing_part(p_canonical, labels, config.contact * spacing)
    else:
        root = base_part(samples, Ts_frame_canonical, sizes, config.still * spacing)
    links = directed(tree, root)
    parent, child = links[:, 0], links[:, 1]
    states = np.concatenate(
        [np.zeros((len(Ts_frame_canonical), 0)), *(fits.states_of((a, b)) for a, b in links.tolist())], axis=1
    )
    e_spatial, e_1dof = spatial[parent, child], one_dof[parent, child]
    return KinematicModel(
        canonical_frame=canonical_frame,
        root=root,
        labels=labels,
        Ts_frame_canonical=Ts_frame_canonical,
        joint_parent=parent,
        joint_child=child,
        joint_types=(SCREW.name,) * len(links),
        axis=fits.axis[parent, child],
        point=fits.point[parent, child],
        states=states,
        e_spatial=e_spatial,
        e_1dof=e_1dof,
        energies={
            "E_project": float(config.lambda_spatial * e_spatial.sum() + config.lambda_1dof * e_1dof.sum()),
            "E_group": group_energy(p_canonical, labels),
        },
    )


def part_samples(
    p_canonical: Float64[np.ndarray, "points 3"], labels: Int64[np.ndarray, "points"], count: int
) -> Float64[np.ndarray, "parts count 3"]:
    """`count` farthest points of each part; a smaller part's are repeated."""
    samples = []
    for part in range(labels.max() + 1):
        members = p_canonical[labels == part]
        samples.append(members[np.resize(farthest_points(members, count), count)])
    return np.stack(samples)


def spatial_energies(
    p: Float64[np.ndarray, "points 3"], labels: Int64[np.ndarray, "points"], contact: float
) -> Float64[np.ndarray, "parts parts"]:
    """E_spatial of every pair of parts: the squared least distance between their points, beyond `contact`.

    Within the distance at which sampled surfaces touch, distances tell of the sampling only.
    """
    parts = [p[labels == part] for part in range(labels.max() + 1)]
    trees = [KDTree(part) for part in parts]
    energies = np.zeros((len(parts), len(parts)))
    for a, b in combinations(range(len(parts)), 2):
        gap = nearest(trees[a], parts[b])[0].min() - contact
        energies[a, b] = energies[b, a] = max(gap, 0.0) ** 2
    return energies


def relative_joints(
    kind: JointKind,
    samples: Float64[np.ndarray, "parts count 3"],
    Ts_frame_canonical: Float64[np.ndarray, "frames parts 4 4"],
) -> JointFit:
    """The best joint of one kind of every part (second axis) against every other (first axis).

    The mean squared distance that it leaves is E_1DOF of a screw (Eq. 12), and E_3DOF of a spherical joint: how well
    the motion is a rotation about one fixed centre.
    """
    Ts = Ts_frame_canonical.swapaxes(0, 1)
    Ts_parent_child = inverse(Ts)[:, None] @ Ts[None, :]
    return fit_joint([kind], Ts_parent_child, np.broadcast_to(samples, (len(samples), *samples.shape)))


def base_part(
    samples: Float64[np.ndarray, "parts count 3"],
    Ts_frame_canonical: Float64[np.ndarray, "frames parts 4 4"],
    sizes: Int64[np.ndarray, "parts"],
    still: float,
) -> int:
    """The part whose points move least over all frames; the largest one where even that moves more than `still`.

    A fixed base stands still. Of a free one nothing but its size tells: the trunk is not the part that moves least.
    """
    moved = move_points(Ts_frame_canonical[:, :, None], samples) - samples
    travel = np.linalg.norm(moved, axis=-1).mean(axis=(0, 2))
    return int(travel.argmin() if travel.min() <= still else sizes.argmax())


def middle_part(tree: nx.Graph, sizes: Int64[np.ndarray, "parts"]) -> int:
    """The part from which all points are the fewest links away: a person's trunk, whichever foot stands still."""
    links_away = nx.floyd_warshall_numpy(tree, nodelist=range(len(sizes)), weight=None)
    return int((links_away @ sizes).argmin())


def standing_part(
    p_canonical: Float64[np.ndarray, "points 3"], labels: Int64[np.ndarray, "points"], contact: float
) -> int:
    """The largest of the parts that reach down to the lowest part's points, within `contact`; z is up."""
    parts = labels.max() + 1
    lowest = np.array([np.percentile(p_canonical[labels == part, 2], LOWEST) for part in range(parts)])
    sizes = np.bincount(labels, minlength=parts)
    return int(np.where(lowest <= lowest.min() + contact, sizes, 0).argmax())


def spanning_tree(cost: Float64[np.ndarray, "parts parts"]) -> nx.Graph:
    """The minimum spanning tree of all parts."""
    graph = nx.Graph()
    graph.add_nodes_from(range(len(cost)))
    graph.add_weighted_edges_from((a, b, float(cost[a, b])) for a in range(len(cost)) for b in range(a + 1, len(cost)))
    return cast(nx.Graph, nx.minimum_spanning_tree(graph))


def directed(tree: nx.Graph, root: int) -> Int64[np.ndarray, "joints 2"]:
    """(parent, child) of each link of a tree, parents before their children."""
    links = list(nx.bfs_edges(tree, root, sort_neighbors=sorted))
    return np.array(links, dtype=np.int64).reshape(-1, 2)


def group_energy(p_canonical: Float64[np.ndarray, "points 3"], labels: Int64[np.ndarray, "points"]) -> float:
    """E_group (A.5): mean over parts of the mean squared distance of a part's points from their centre."""
    spreads = []
    for part in np.unique(labels):
        members = p_canonical[labels == part]
        spreads.append(np.mean(((members - members.mean(axis=0)) ** 2).sum(axis=1)))
    return float(np.mean(spreads))
