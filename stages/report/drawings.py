"""Inline SVG of the kinematic tree, of residuals as a heat map and as curves, and of a joint's states as a curve."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from jaxtyping import Float64

from schemas.model_file import ModelFile
from stages.kernels.labelling.colours import distinct_colours, hexadecimal
from stages.report.tree_layout import tree_layout

NODE, LEAF_WIDTH, LEVEL_HEIGHT, MARGIN = 14, 48, 62, 22  # of the tree, in pixels
LEFT, ROW, CURVES = 64, 22, 120  # of the residuals: width of labels, height of a row and of the curves
WIDTH, NARROWEST, WIDEST, NUMBERED = 660, 4, 52, 34  # of all columns, of one, and of one with numbers


def tree_svg(model: ModelFile) -> str:
    """The tree with numbered nodes, and edges marked by their joint's type."""
    layout = tree_layout([(joint.parent, joint.child) for joint in model.joints], model.root)
    places = {
        part: (MARGIN + NODE + (x - 1) * LEAF_WIDTH, MARGIN + depth * LEVEL_HEIGHT)
        for part, (x, depth) in layout.items()
    }
    colours = distinct_colours(len(model.parts))
    shapes = []
    for joint in model.joints:
        (x0, y0), (x1, y1) = places[joint.parent], places[joint.child]
        x, y = x0 + 0.6 * (x1 - x0), y0 + 0.6 * (y1 - y0)  # beyond the middle, where siblings' edges are apart
        dashes = ' stroke-dasharray="6 4"' if joint.kind.turns == "none" else ""
        shapes.append(
            f'<g><title>{escape(joint.name)}, {joint.type}</title><path class="edge"{dashes} d="M{x0:g} {y0:g}L{x1:g} '
            f'{y1:g}"/><circle class="mark" cx="{x:g}" cy="{y:g}" r="8"/>{_text(x, y + 4, joint.kind.mark)}</g>'
        )
    for part in model.parts:
        if part.id in places:
            x, y = places[part.id]
            shapes.append(
                f'<g><title>{escape(part.name)}</title><circle class="node" cx="{x:g}" cy="{y:g}" r="{NODE}" '
                f'stroke="{hexadecimal(colours[part.id])}"/>{_text(x, y + 4, str(part.id))}</g>'
            )
    links = ", ".join(f"{joint.parent} to {joint.child} {joint.type}" for joint in model.joints)
    width = max(x for x, _ in places.values()) + NODE + MARGIN
    height = max(y for _, y in places.values()) + NODE + MARGIN
    return _svg(width, height, f"Kinematic tree: root {model.root}; {links or 'no joints'}", shapes)


def heat_svg(
    residuals: Float64[np.ndarray, "frames parts"], canonical_frame: int, floor: float, names: Sequence[str]
) -> str:
    """A row for each part and a column for each frame, in % of the diagonal. Colour marks residuals above noise."""
    column, top = _column(len(residuals)), _top(residuals, floor)
    shapes = []
    for part, name in enumerate(names):
        y = part * ROW
        shapes.append(_text(LEFT - 8, y + 15, str(part), "end"))
        for frame, value in enumerate(residuals[:, part]):
            x = LEFT + frame * column
            canonical = frame == canonical_frame
            what = "canonical" if canonical else f"{value:.2f} %"
            depth = float(np.clip((value - floor / 2) / (top - floor / 2), 0, 1))
            shapes.append(
                f"<g><title>{escape(name)}, frame {frame}: {what}</title>"
                f'<rect class="grid" fill="none" x="{x:g}" y="{y}" width="{column:g}" height="{ROW}"/>'
                f'<rect class="cell" fill-opacity="{depth:.3f}" x="{x:g}" y="{y}" '
                f'width="{column - 1:g}" height="{ROW - 1}"/>'
            )
            if column >= NUMBERED:
                light = ' style="fill:var(--page)"' if depth > 0.6 else ""
                shapes.append(_text(x + column / 2, y + 15, "-" if canonical else f"{value:.2f}", more=light))
            shapes.append("</g>")
    shapes += _frame_numbers(len(residuals), column, len(names) * ROW + 16)
    shapes.append(_text(4, 15, "part", "start", ' class="soft"'))
    worst = f"largest {residuals.max():.2f} %" if residuals.size else "none"
    return _svg(
        LEFT + column * len(residuals) + 12, len(names) * ROW + 24, f"Residual by part and frame: {worst}", shapes
    )


def curves_svg(
    residuals: Float64[np.ndarray, "frames parts"],
    weights: Float64[np.ndarray, "parts"],
    canonical_frame: int,
    floor: float,
) -> str:
    """Curves of the residual of all points and of the worst part in each frame, and the floor due to sampling.

    The curves have a gap at the canonical frame, which has no residual.
    """
    whole = np.sqrt(residuals**2 @ (weights / weights.sum()))
    worst = residuals.max(axis=1)
    column, top = _column(len(residuals)), _top(residuals, floor)
    width = column * len(residuals)

    def height(value: float) -> float:
        return 8 + (CURVES - 16) * (1 - value / top)

    shapes = []
    for value in (0.0, top / 2, top):
        y = height(value)
        shapes.append(
            f'<path class="grid" d="M{LEFT} {y:g}h{width:g}"/>{_text(LEFT - 8, y + 4, f"{value:.2f}", "end")}'
        )
    shapes.append(_text(4, height(top) + 4, "%", "start", ' class="soft"'))
    shapes.append(
        f'<path class="floor" d="M{LEFT} {height(floor):g}h{width:g}"><title>sampling: {floor:.2f} %</title></path>'
    )
    for values, classes, name in ((whole, "curve", "all points"), (worst, "curve second", "worst part")):
        for stretch in (range(canonical_frame), range(canonical_frame + 1, len(values))):
            if stretch:
                path = _path([LEFT + (t + 0.5) * column for t in stretch], [height(values[t]) for t in stretch])
                shapes.append(f'<path class="{classes}" d="{path}"><title>{name}</title></path>')
    what = f"Residual by frame: {whole.max():.2f} % at most, {worst.max():.2f} % of a part, {floor:.2f} % by sampling"
    return _svg(LEFT + width + 12, CURVES, what, shapes)


def states_svg(states: Sequence[float], canonical_frame: int) -> str:
    """A curve of a joint's states over the frames, with a dot at the canonical frame."""
    values = np.array(states, dtype=np.float64)
    low, range_ = values.min(), np.ptp(values) or 1.0
    x = [2 + 86 * t / max(len(values) - 1, 1) for t in range(len(values))]
    y = [19 - 16 * (value - low) / range_ for value in values]
    dot = f'<circle cx="{x[canonical_frame]:.1f}" cy="{y[canonical_frame]:.1f}" r="2.5" fill="var(--ink)"/>'
    return _svg(90, 22, "states by frame", [f'<path class="curve" d="{_path(x, y)}"/>{dot}'])


def _svg(width: float, height: float, what: str, shapes: Sequence[str]) -> str:
    return (
        f'<svg role="img" aria-label="{escape(what)}" width="{width:g}" height="{height:g}" '
        f'viewBox="0 0 {width:g} {height:g}">{"".join(shapes)}</svg>'
    )


def _text(x: float, y: float, text: str, anchor: str = "middle", more: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}"{more}>{escape(text)}</text>'


def _path(x: Sequence[float], y: Sequence[float]) -> str:
    return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)) + "h0"  # a single point is a dot


def _column(frames: int) -> float:
    return float(np.clip(WIDTH / frames, NARROWEST, WIDEST))


def _top(residuals: Float64[np.ndarray, "frames parts"], floor: float) -> float:
    """The residual at the scales' upper end. It stays above the noise, so that noise does not look like misfit."""
    return max(float(residuals.max(initial=0.0)), 3 * floor) or 1.0


def _frame_numbers(frames: int, column: float, y: float) -> list[str]:
    step = max(1, int(np.ceil(24 / column)))
    numbers = [
        _text(LEFT + (frame + 0.5) * column, y, str(frame), more=' class="soft"') for frame in range(0, frames, step)
    ]
    return [*numbers, _text(4, y, "frame", "start", ' class="soft"')]
