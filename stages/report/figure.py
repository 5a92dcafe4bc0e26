"""A picture of a fitted model, with the panels of the supplement's figures 6 and 8, and of the truth below it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from jaxtyping import Float, Float64, Int64

from schemas.joints import JOINT_KINDS, JointKind
from schemas.model_file import Result
from schemas.sequence import GroundTruth, IngestedSequence
from stages.evaluation.true_motion import true_positions
from stages.kernels.labelling.colours import colours_of_true_parts, distinct_colours
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.sampling import thinned
from stages.report.tree_layout import tree_layout
from stages.support.pictures import Axes, Axes3D, Figure, Line3DCollection, colormaps

AXIS_LENGTH = 0.24  # of a drawn joint axis, as a share of the longest side
AXIS_COLOUR = "#d11f2a"
MOST_POINTS = 5000  # in a panel
ARROWS = 800  # in a panel of implied flow
PANEL = 3.6  # inches


@dataclass(frozen=True)
class Model:
    """The content of a row of panels: points by part in every frame, links (parent, child, mark), and joint axes."""

    name: str
    colours: Float64[np.ndarray, "parts 3"]
    labels: Int64[np.ndarray, "points"]
    p_frames: Float64[np.ndarray, "frames points 3"]
    root: int | None
    links: list[tuple[int, int, str]]
    axes: list[tuple[int, JointKind, Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]]  # child, kind, axis, point


def draw(result: Result, ingested: IngestedSequence | None = None) -> Figure:
    """Draw a row of panels: the input, the parts with screw axes, the tree, the implied flow, and another frame.

    `ingested` is the sequence that the model was fitted to. Without it the canonical frame serves as the input. If it
    holds the truth, a second row shows the true parts, in the colours of the found parts that they match.
    """
    canonical = result.model.canonical_frame
    chosen = thinned(len(result.labels), MOST_POINTS)
    models = [_fitted(result, chosen)]
    inputs = [result.canonical_points]
    if ingested is not None:
        sequence = ingested.sequence
        frames = sequence.frames()
        inputs = [sequence.to_input(frames[t]) for t in sorted({0, canonical, len(frames) - 1})]
        if ingested.truth is not None and ingested.of_object(canonical).any():
            models.append(_true(ingested, ingested.truth, result, chosen))
    p_canonical, p_frames = models[0].p_frames[canonical], models[0].p_frames
    low, high = p_frames.min(axis=(0, 1)), p_frames.max(axis=(0, 1))
    bounds = (low + high) / 2, float((high - low).max()) / 2
    farthest = int(np.linalg.norm(p_frames - p_canonical, axis=-1).mean(axis=1).argmax())
    swiftest = int(np.linalg.norm(np.diff(p_frames, axis=0), axis=-1).mean(axis=1).argmax()) if len(p_frames) > 1 else 0
    figure = Figure(figsize=(5 * PANEL, len(models) * PANEL))
    grid = figure.add_gridspec(
        len(models), 5, left=0.005, right=0.995, bottom=0.01, top=1 - 0.09 / len(models), wspace=0.02, hspace=0.12
    )

    def scene(place: Any, title: str) -> Axes3D:
        axes = cast(Axes3D, figure.add_subplot(place, projection="3d"))
        _set_up(axes, title, bounds)
        return axes

    _input(scene(grid[:, 0], f"input, {counted(len(inputs), 'frame')}, late ones light"), inputs)
    for row, model in enumerate(models):
        colours = model.colours[model.labels]
        found = counted(len(np.unique(model.labels)), f"{model.name}part")
        parts = scene(grid[row, 1], f"{found}, {counted(len(model.axes), 'joint')}")
        _points(parts, model.p_frames[canonical], colours)
        _joint_axes(parts, model, canonical, bounds[1])
        _tree(figure.add_subplot(grid[row, 2]), model)
        flow = scene(grid[row, 3], f"{model.name}flow, frame {swiftest} to {swiftest + 1}")
        _flow(flow, model.p_frames[swiftest : swiftest + 2])
        _points(scene(grid[row, 4], f"{model.name}pose of frame {farthest}"), model.p_frames[farthest], colours)
    return figure


def _fitted(result: Result, chosen: Int64[np.ndarray, "chosen"]) -> Model:
    model, labels = result.model, result.labels[chosen]
    T = result.T_frame_canonical[:, labels]
    return Model(
        name="",
        colours=distinct_colours(len(model.parts)),
        labels=labels,
        p_frames=move_points(T, result.canonical_points[chosen].astype(np.float64)),
        root=model.root,
        links=[(joint.parent, joint.child, joint.kind.mark) for joint in model.joints],
        axes=[(joint.child, joint.kind, np.array(joint.axis), np.array(joint.point)) for joint in model.joints],
    )


def _true(
    ingested: IngestedSequence,
    truth: GroundTruth,
    result: Result,
    chosen: Int64[np.ndarray, "chosen"],
) -> Model:
    """The truth in the input's coordinates, with its joints posed in the canonical frame."""
    sequence, canonical = ingested.sequence, result.model.canonical_frame
    labels_true = ingested.true_labels(canonical)
    assert labels_true is not None
    of_object = ingested.of_object(canonical)
    shown = chosen[of_object[chosen]]
    p_frames = true_positions(ingested, canonical)
    assert p_frames is not None
    types = {(joint.parent, joint.child): joint.kind.mark for joint in truth.joints}
    linked = [(int(parent), part) for part, parent in enumerate(truth.parent) if parent >= 0]
    roots = np.flatnonzero(truth.parent == -1)
    axes = []
    for joint in truth.joints:
        # a ball joint's centre moves with the child, since a soft parent bends between its joints
        T_canonical_first = truth.Ts_frame_first[canonical, joint.child if joint.kind.is_ball else joint.parent]
        point = sequence.to_input(T_canonical_first[:3, :3] @ np.array(joint.point) + T_canonical_first[:3, 3])
        axes.append((joint.child, joint.kind, T_canonical_first[:3, :3] @ np.array(joint.axis), point))
    return Model(
        name="true ",
        colours=colours_of_true_parts(result.labels, labels_true, len(truth.parent)),
        labels=labels_true[shown],
        p_frames=sequence.to_input(p_frames[:, np.cumsum(of_object)[shown] - 1]),
        root=int(roots[0]) if len(roots) == 1 else None,  # several roots mean that the tree is unknown
        links=[(parent, child, types.get((parent, child), "")) for parent, child in linked],
        axes=axes,
    )


def _set_up(axes: Axes3D, title: str, bounds: tuple[Float64[np.ndarray, "3"], float]) -> None:
    centre, half = bounds
    limits = {f"{axis}lim": (c - half, c + half) for axis, c in zip("xyz", centre.tolist(), strict=True)}
    axes.set(title=title, **limits)
    axes.set_box_aspect((1, 1, 1), zoom=1.25)
    axes.set_axis_off()


def _points(axes: Axes3D, p: Float[np.ndarray, "points 3"], colour: Any, size: float = 2.0) -> None:
    axes.scatter(p[:, 0], p[:, 1], p[:, 2], c=colour, s=size, linewidths=0, rasterized=True)


def _input(axes: Axes3D, frames: list[Float[np.ndarray, "_ 3"]]) -> None:
    shades = colormaps["cividis"](np.linspace(0.0, 0.85, len(frames)))
    for frame, shade in zip(frames, shades, strict=True):
        _points(axes, frame[thinned(len(frame), MOST_POINTS)], [shade], size=1.2)


def _joint_axes(axes: Axes3D, model: Model, canonical_frame: int, half: float) -> None:
    """Draw each joint's axis as a line near its child part's middle: dashed if prismatic, as a dot if spherical."""
    for part, kind, direction, point in model.axes:
        child = model.p_frames[canonical_frame][model.labels == part]
        middle = point + direction * (direction @ (child.mean(axis=0) - point)) if len(child) else point
        if not kind.has_axis:
            axes.plot(*point[:, None], color=AXIS_COLOUR, marker="o", markersize=5)
            continue
        ends = np.stack([middle - AXIS_LENGTH * half * direction, middle + AXIS_LENGTH * half * direction])
        axes.plot(*ends.T, color=AXIS_COLOUR, linewidth=1.8, linestyle="--" if kind.turns == "none" else "-")


def _tree(axes: Axes, model: Model) -> None:
    axes.set_axis_off()
    if model.root is None:
        axes.set(title=f"{model.name}tree: unknown")
        return
    axes.set(title=f"{model.name}tree ({_marks(model)})")
    places = tree_layout([(parent, child) for parent, child, _ in model.links], model.root)
    layout = {part: (x, -depth) for part, (x, depth) in places.items()}
    for parent, child, mark in model.links:
        (x0, y0), (x1, y1) = layout[parent], layout[child]
        axes.plot([x0, x1], [y0, y1], color="#5a6670", linewidth=1, zorder=1)
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1}
        axes.text((x0 + x1) / 2, (y0 + y1) / 2, mark, fontsize=7, ha="center", va="center", bbox=box)
    for part, (x, y) in layout.items():
        axes.scatter(x, y, s=190, color="white", edgecolors=[model.colours[part]], linewidths=2.5, zorder=2)
        axes.text(x, y, str(part), fontsize=8, ha="center", va="center", zorder=3)
    axes.margins(0.12)


def _marks(model: Model) -> str:
    """A legend of the links' marks. It always explains hinges and slides."""
    shown = {mark for _, _, mark in model.links} | {"R", "P"}
    return ", ".join(f"{kind.mark} {kind.name}" for kind in JOINT_KINDS.values() if kind.mark in shown)


def _flow(axes: Axes3D, p_pair: Float64[np.ndarray, "pair points 3"]) -> None:
    """Draw the motion of points from one frame to the next as lines, brighter for larger motions."""
    start, end = p_pair[0], p_pair[-1]
    _points(axes, start, "#b8c0c7", size=1.0)
    shown = thinned(len(start), ARROWS)
    length = np.linalg.norm(end - start, axis=-1)[shown]
    shades = colormaps["viridis"](length / (length.max() or 1.0))
    axes.add_collection3d(Line3DCollection(np.stack([start, end], axis=1)[shown], colors=shades, linewidths=1.1))


def counted(number: int, what: str) -> str:
    """A number with its noun, as in `2 parts` or `1 joint`."""
    return f"{number} {what}{'' if number == 1 else 's'}"
