"""The page's tables and sliders as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from schemas.assessment import Spread
from schemas.joints import Freedom
from schemas.metrics import JointMetrics, Metrics
from schemas.model_file import ModelFile, ModelJoint
from schemas.scores import MEASURES
from schemas.sequence import LENGTH_SYMBOLS
from stages.evaluation.summary import figures_of
from stages.kernels.labelling.colours import distinct_colours, hexadecimal
from stages.report.drawings import states_svg

MEANINGS = {
    "ari": "adjusted Rand index of the labels; 1 is the truth",
    "ri": "Rand index of the labels",
    "tree_edit_distance": "steps from the tree found to the true one",
    "recon_cm": "mean distance of points from where they truly are",
    "recon_percent": "the same, % of the diagonal",
    "recon_of_motion_percent": "the same, % of the mean true way from the canonical frame",
    "placement_percent": "the same with the place of the whole in each frame's own coordinates",
    "epe_cm": "mean error of the flow between frames",
    "epe_percent": "the same, % of the diagonal",
    "epe_of_flow_percent": "the same, % of the mean true flow",
    "acc5": "share of the flow that is right within 5 mm or 0.5 %",
    "acc10": "share of the flow that is right within 10 mm or 1 %",
    "reanimation_cm": "mean distance in unseen poses, one point of each part given",
    "reanimation_percent": "the same, % of the diagonal",
    "chamfer_percent": "mean nearest distance between model and frames, % of the diagonal",
    "moving_joints_found": "share of the true joints that move by more than three point spacings that were found",
    "axis_angle_deg": "median angle between found and true axes",
    "axis_angle_mean_deg": "mean angle between them",
    "axis_distance_percent": "median distance between them, % of the diagonal",
    "ball_centre_percent": "mean distance between found and true centres of ball joints, % of the diagonal",
    "joint_type_accuracy": "share of the joints found whose type is right",
}
DIRECTIONS: dict[Freedom, tuple[str, ...]] = {"none": (), "axis": ("",), "all": ("x", "y", "z")}
HEADLINE = ("ari", "recon_percent", "epe_percent", "tree_edit_distance")


def headline(model: ModelFile, metrics: Metrics | None) -> str:
    """The main figures at the top of the page."""
    if metrics is None or metrics.parts_true is None:
        return ""
    figures = figures_of(metrics, {})
    items = [f"<li><span>true parts</span> <b>{metrics.parts_true}</b></li>"]
    for name in HEADLINE:
        measure, value = MEASURES[name], getattr(figures, name)
        if value is not None:
            text = f"{_number(value, measure.decimals)} {measure.unit}".strip()
            items.append(f'<li title="{MEANINGS[name]}"><span>{measure.title}</span> <b>{text}</b></li>')
    return f'<ul class="headline">{"".join(items)}</ul>'


def verdict_box(model: ModelFile) -> str:
    """How far the model can be trusted, and why; empty for a model of an earlier release."""
    if model.verdict is None:
        return ""
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in model.verdict.reasons)
    return f'<div class="verdict {model.verdict.trust}"><b>trust: {model.verdict.trust}</b><ul>{reasons}</ul></div>'


def sliders(model: ModelFile) -> str:
    """A row for each joint, with a slider for each number of its state. The joint's limits bound the slider."""
    colours = [hexadecimal(colour) for colour in distinct_colours(len(model.parts))]
    rows = []
    for joint in model.joints:
        ends = " <span class='arrow'>→</span> ".join(badge(part, colours[part]) for part in (joint.parent, joint.child))
        what = f"{joint.name}, {joint.type}, part {joint.parent} to part {joint.child}"
        fields = _sliders(joint, _length(model), what)
        rows.append(f'<li><span>{ends} {escape(joint.name)}</span> <span class="kind">{joint.type}</span>{fields}</li>')
    return f"<ol>{''.join(rows)}</ol>" if rows else '<p class="soft">One rigid part: nothing to move.</p>'


def badge(part: int, colour: str) -> str:
    """A part's number in a ring of its colour."""
    return f'<span class="badge" style="--part:{colour}">{part}</span>'


def parts_table(model: ModelFile) -> str:
    """The number and share of points of each part."""
    total = sum(part.point_count for part in model.parts) or 1
    rows = []
    for part, colour in zip(model.parts, distinct_colours(len(model.parts)), strict=True):
        share, shade = part.point_count / total, hexadecimal(colour)
        bar = f'<span class="bar" style="--part:{shade}"><i style="width:{100 * share:.0f}%"></i></span>'
        root = " (root)" if part.id == model.root else ""
        rows.append(
            [f"{badge(part.id, shade)} {escape(part.name)}{root}", str(part.point_count), f"{bar}{100 * share:.1f} %"]
        )
    return table(("part", "points", "share"), rows)


def joints_table(model: ModelFile) -> str:
    """Type, links, axis, range, states and confidence of each joint."""
    colours = [hexadecimal(colour) for colour in distinct_colours(len(model.parts))]
    sure = any(joint.confidence for joint in model.joints)
    rows = []
    for joint in model.joints:
        links = f"{badge(joint.parent, colours[joint.parent])} → {badge(joint.child, colours[joint.child])}"
        curves = zip(*(joint.sizes(state) for state in joint.states), strict=True)
        spread = joint.spread or Spread()
        axis = _vector(joint.axis) + _plus_minus(spread.direction, "rad")
        point = _vector(joint.point) + _plus_minus(spread.place, _length(model))
        row = [escape(joint.name), joint.type, links, axis, point, _range(model, joint)]
        row.append("".join(states_svg(states, model.canonical_frame) for states in curves))
        if sure:
            told = joint.confidence
            row += ["-"] * 3 if told is None else [f"{value:.2f}" for value in (told.part, told.link, told.type)]
        rows.append(row)
    columns = ("joint", "type", "parts", "axis", f"point, {LENGTH_SYMBOLS[model.units]}", "range", "states")
    return table(columns + (("sure of parts", "of link", "of type") if sure else ()), rows, words=(1, 2))


def figures_table(metrics: Metrics) -> str:
    """Every metric of the evaluation, with its meaning."""
    figures = figures_of(metrics, {})
    rows = []
    for name, meaning in MEANINGS.items():
        text = _number(getattr(figures, name), MEASURES[name].decimals)
        if text != "-":
            rows.append([escape(_title(name)), text, escape(meaning)])
    return table(("figure", "value", "meaning"), rows, loose=(2,))


def true_joints_table(joints: Iterable[JointMetrics]) -> str:
    """Each true joint and the one that was found in its place."""
    rows = []
    for joint in joints:
        angle = joint.state_error if joint.true_type == "revolute" else None
        error = _number(joint.state_error, 2) if angle is None else f"{np.degrees(angle):.1f}°"
        rows.append(
            [
                escape(joint.name),
                joint.true_type,
                joint.predicted_type or "not found",
                "-" if joint.axis_angle_deg is None else f"{joint.axis_angle_deg:.1f}°",
                _number(joint.axis_distance_percent, 2),
                error,
                _number(joint.confidence, 2),
            ]
        )
    columns = ("true joint", "type", "found", "axis off by", "axis distance, %", "states off by", "sure")
    return table(columns, rows, words=(1, 2)) if rows else ""


def table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], words: Sequence[int] = (), loose: Sequence[int] = ()
) -> str:
    """A table of HTML cells. `words` are columns of text; `loose` ones are such columns whose lines may break."""

    def kind(column: int) -> str:
        classes = " ".join(name for name, of in (("word", (*words, *loose)), ("loose", loose)) if column in of)
        return f' class="{classes}"' if classes else ""

    head = "".join(f'<th scope="col"{kind(i)}>{escape(title)}</th>' for i, title in enumerate(columns))
    body = "".join(
        f'<tr><th scope="row">{row[0]}</th>'
        + "".join(f"<td{kind(i)}>{cell}</td>" for i, cell in enumerate(row[1:], start=1))
        + "</tr>"
        for row in rows
    )
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _sliders(joint: ModelJoint, length: str, what: str) -> str:
    """A slider for each number of a joint's state. If there are several, each has its direction as a label."""
    kind, fields = joint.kind, []
    directions = DIRECTIONS[kind.turns] + DIRECTIONS[kind.slides]
    for (lower, upper), unit, direction in zip(_limits(joint), kind.symbols(length), directions, strict=True):
        which = f", {'about' if unit == 'rad' else 'along'} {direction or 'its axis'}" if kind.size > 1 else ""
        fields.append(_slider(joint, lower, upper, unit, direction, what + which))
    return "".join(fields)


def _slider(joint: ModelJoint, lower: float, upper: float, unit: str, direction: str, what: str) -> str:
    disabled = " disabled" if upper - lower <= 0 else ""
    low, high = (_value(value, unit) for value in (lower, upper))
    limits = f'min="{lower!r}" max="{upper!r}" step="any" value="0"'
    return (
        f'<div class="slider"><span class="low">{f"{direction} {low}".strip()}</span><input type="range" '
        f'data-joint="{joint.id}" data-unit="{unit}" {limits} aria-label="{escape(what)}"{disabled}>'
        f"<span>{high}</span><output></output></div>"
    )


def _limits(joint: ModelJoint) -> list[tuple[float, float]]:
    """The limits of each number of a joint's state. For the slides of a ball they are the range of the states."""
    if not joint.kind.is_ball:
        return list(zip(joint.lowers, joint.uppers, strict=True))
    most = max(joint.uppers[0], *(joint.sizes(state)[0] for state in joint.states))
    slides = np.array(joint.states)[:, joint.kind.angles :]
    return [(-most, most)] * joint.kind.angles + [(min(slide), max(slide)) for slide in slides.T.tolist()]


def _length(model: ModelFile) -> str:
    """The symbol of the model's unit of length; empty if it is unknown."""
    return "" if model.units == "unknown" else LENGTH_SYMBOLS[model.units]


def _range(model: ModelFile, joint: ModelJoint) -> str:
    ranges = joint.ranges(_length(model))
    return ", ".join(f"{_value(lower, unit)} to {_value(upper, unit)}" for lower, upper, unit in ranges)


def _value(value: float, unit: str) -> str:
    """Format an angle in degrees, or a length with its unit."""
    if unit == "rad":
        return f"{round(np.degrees(value))}°"
    return f"{value + 0.0:.3g} {unit}".strip()


def _vector(p: Sequence[float]) -> str:
    return " ".join(f"{round(value, 3) + 0.0:.3f}" for value in p)  # + 0.0: no "-0.000"


def _plus_minus(spread: float | None, unit: str) -> str:
    """A spread behind what it belongs to, with two digits."""
    if spread is None:
        return ""
    text = f"{np.degrees(spread):.2g}°" if unit == "rad" else f"{spread:.2g} {unit}".strip()
    return f' <span class="soft">± {text}</span>'


def _title(name: str) -> str:
    return f"{MEASURES[name].title} {MEASURES[name].unit}".strip()


def _number(value: float | None, decimals: int) -> str:
    if value is None:
        return "-"
    return f"{value:.{decimals}f}".removesuffix(".0") if decimals == 1 else f"{value:.{decimals}f}"
