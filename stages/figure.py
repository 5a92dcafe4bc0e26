"""A picture of a fitted model: the input, its parts with their joint axes, a later frame, and the tree."""

from __future__ import annotations

from typing import Any, cast

import matplotlib

matplotlib.use("Agg")  # no screen is needed, nor looked for

import networkx as nx
import numpy as np
from jaxtyping import Float, Int64
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D

from schemas.model_file import ModelFile, Result
from stages.kernels.matching import match_parts
from stages.kernels.palette import part_colours

AXIS_LENGTH = 0.12  # half length of a drawn joint axis, as a share of the diagonal
JOINT_MARKS = {"revolute": "R", "prismatic": "P", "spherical": "S"}


def draw(result: Result, labels_true: Int64[np.ndarray, "points"] | None = None) -> Figure:
    """The model on one sheet: canonical input, parts and axes, the farthest frame as posed by the model, tree.

    With the true labels of the canonical points, the true parts stand beside the predicted ones; a true part has the
    colour of the predicted part that it is matched to.
    """
    p = result.canonical_points.astype(np.float64)
    colours = part_colours(len(result.model.parts))[result.labels]
    bounds = p.mean(axis=0), np.ptp(p, axis=0).max() / 2
    T_points = result.T_frame_canonical[:, result.labels]
    posed = np.einsum("tnij,nj->tni", T_points[..., :3, :3], p) + T_points[..., :3, 3]
    frame = int(np.linalg.norm(posed - p, axis=-1).mean(axis=1).argmax())
    panels = [
        (p, "#777777", f"input, frame {result.model.canonical_frame} (canonical)"),
        (p, colours, f"{len(result.model.parts)} parts, {len(result.model.joints)} joints"),
        (posed[frame], colours, f"the model posed as in frame {frame}"),
    ]
    if labels_true is not None:
        true_parts = (p, true_colours(result.labels, labels_true), f"{len(np.unique(labels_true))} true parts")
        panels.insert(2, true_parts)
    count = len(panels) + 1
    figure = Figure(figsize=(4 * count, 4), layout="constrained")
    for column, (points, colour, title) in enumerate(panels):
        axes = cast(Axes3D, figure.add_subplot(1, count, column + 1, projection="3d"))
        _scatter(axes, points, colour, title, bounds)
        if column == 1:
            _joint_axes(axes, result, 2 * AXIS_LENGTH * bounds[1])
    _tree(figure.add_subplot(1, count, count), result.model)
    return figure


def true_colours(
    labels: Int64[np.ndarray, "points"], labels_true: Int64[np.ndarray, "points"]
) -> Float[np.ndarray, "points 3"]:
    """The colour of each point's true part: its predicted part's, or one of its own where it has none."""
    matched = match_parts(labels, labels_true)
    own = len(np.unique(labels)) + np.arange(labels_true.max() + 1)
    colour_of = np.array([matched.get(part, own[part]) for part in range(len(own))])
    return part_colours(int(colour_of.max()) + 1)[colour_of[labels_true]]


def _scatter(axes: Axes3D, p: Float[np.ndarray, "points 3"], colour: Any, title: str, bounds: tuple) -> None:
    axes.scatter(p[:, 0], p[:, 1], p[:, 2], c=colour, s=1.5, linewidths=0)
    centre, half = bounds
    axes.set(
        xlim=(centre[0] - half, centre[0] + half),
        ylim=(centre[1] - half, centre[1] + half),
        zlim=(centre[2] - half, centre[2] + half),
        title=title,
    )
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    axes.set_axis_off()


def _joint_axes(axes: Axes3D, result: Result, length: float) -> None:
    """Each joint's axis as a line beside its child part's centre; prismatic ones dashed."""
    for joint in result.model.joints:
        direction, point = np.array(joint.axis), np.array(joint.point)
        child = result.canonical_points[result.labels == joint.child].mean(axis=0)
        centre = point + direction * (direction @ (child - point))
        ends = np.stack([centre - length * direction, centre + length * direction])
        axes.plot(*ends.T, color="black", linewidth=1.5, linestyle="--" if joint.type == "prismatic" else "-")


def _tree(axes: Axes, model: ModelFile) -> None:
    graph = nx.DiGraph()
    graph.add_nodes_from(part.id for part in model.parts)
    graph.add_edges_from((joint.parent, joint.child) for joint in model.joints)
    colours = part_colours(len(model.parts))[list(graph.nodes)]
    layout = tree_layout(graph, model.root)
    nx.draw_networkx(graph, layout, ax=axes, node_color=colours, font_color="white", font_size=8)
    marks = {(joint.parent, joint.child): JOINT_MARKS[joint.type] for joint in model.joints}
    nx.draw_networkx_edge_labels(graph, layout, marks, ax=axes, font_size=7)
    axes.set(title="kinematic tree (R revolute, P prismatic)")
    axes.set_axis_off()


def tree_layout(graph: nx.DiGraph, root: int) -> dict[int, tuple[float, float]]:
    """A place for each part: leaves side by side, a parent above the middle of its children; no line crosses."""
    layout: dict[int, tuple[float, float]] = {}
    depth = nx.shortest_path_length(graph, root)
    leaves = 0
    for part in nx.dfs_postorder_nodes(graph, root):
        children = list(graph.successors(part))
        if not children:
            leaves += 1
        x = float(np.mean([layout[child][0] for child in children])) if children else float(leaves)
        layout[part] = (x, -float(depth[part]))
    return layout
