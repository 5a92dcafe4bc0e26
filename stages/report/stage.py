"""Report: one self-contained page of a fitted model, with a view in which its joints move."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from string import Template

import numpy as np
from jaxtyping import Float64, Int64

from schemas.metrics import Metrics
from schemas.model_file import ModelFile, Result
from schemas.report import Report
from schemas.robot import Robot
from schemas.sequence import LENGTH_SYMBOLS, IngestedSequence, PointSequence
from stages.kernels.labelling.colours import colours_of_true_parts
from stages.report.drawings import curves_svg, heat_svg, tree_svg
from stages.report.figure import counted, draw
from stages.report.residuals import part_residuals, sampling_floor
from stages.report.scene import scene_data
from stages.report.tables import (
    figures_table,
    headline,
    joints_table,
    parts_table,
    sliders,
    true_joints_table,
    verdict_box,
)
from stages.support.pictures import picture_bytes

VIEWER = (  # the script's files in viewer/, in their order
    "math.js",
    "kinematics.js",
    "scene.js",
    "camera.js",
    "shapes.js",
    "renderer.js",
    "drawing.js",
    "controls.js",
    "navigation.js",
    "start.js",
)
NO_PART_COLOUR = (0.5, 0.5, 0.5)
MODES = {"points": "Points", "meshes": "Meshes", "true": "True parts"}
COLOURINGS = {"part": "By part", "scan": "By scan"}


def compute_report(result: Result, sequence: PointSequence) -> Report:
    """Measure the model's residuals on the sequence that it was fitted to."""
    frames = [sequence.to_input(frame) for frame in sequence.frames()]
    return Report(residuals=part_residuals(result, frames), sampling=sampling_floor(result))


def report_files(
    name: str, result: Result, ingested: IngestedSequence, report: Report, robot: Robot | None, metrics: Metrics | None
) -> dict[str, bytes]:
    """The bytes of report.html, and of report.png, the picture of `stages.report.figure`."""
    sequence = ingested.sequence
    frames = [sequence.to_input(frame) for frame in sequence.frames()]
    labels_true = ingested.true_labels(result.model.canonical_frame)
    picture = picture_bytes(draw(result, ingested), "png", dpi=90)
    page = report_page(name, result, frames, report, robot, metrics, labels_true, sequence.remarks)
    return {"report.html": page.encode(), "report.png": picture}


def report_page(
    name: str,
    result: Result,
    frames: Sequence[Float64[np.ndarray, "_ 3"]],
    report: Report,
    robot: Robot | None = None,
    metrics: Metrics | None = None,
    labels_true: Int64[np.ndarray, "points"] | None = None,
    remarks: Sequence[str] = (),
) -> str:
    """The page as HTML. Its content policy allows no other addresses and no scripts but its own.

    `frames` are in the input's coordinates. `robot` provides the meshes; `metrics` and `labels_true` (of the canonical
    points) the comparison with the truth. `remarks` are those on the input.
    """
    model = result.model
    colours = None
    if labels_true is not None:
        of_parts = colours_of_true_parts(result.labels, labels_true, int(labels_true.max()) + 1)
        colours = np.concatenate([of_parts, [NO_PART_COLOUR]])[labels_true]  # the last is that of NO_PART
    script = _script(VIEWER)
    there = {"points": True, "meshes": robot is not None, "true": labels_true is not None}
    return Template(_resource("page.html")).substitute(
        name=escape(name),
        facts=escape(_facts(model)),
        headline=headline(model, metrics),
        verdict=verdict_box(model),
        remarks="".join(
            f'<p class="remark">{escape(remark)}</p>' for remark in (*remarks, *(robot.remarks if robot else ()))
        ),
        modes="".join(_radio("mode", mode, MODES[mode], mode == "points") for mode in MODES if there[mode]),
        colourings="" if result.colours is None else _colourings(),
        last_frame=model.frames - 1,
        canonical=model.canonical_frame,
        sliders=sliders(model),
        sections="\n".join(_sections(model, report, metrics)),
        footer=_footer(model),
        data=_json_in_html(scene_data(result, frames, robot, colours)),
        style=_resource("style.css"),
        script=script,
        script_digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


def _sections(model: ModelFile, report: Report, metrics: Metrics | None) -> list[str]:
    residuals, floor = report.residuals, report.sampling
    weights = np.array([part.point_count for part in model.parts], dtype=np.float64)
    heat = heat_svg(residuals, model.canonical_frame, floor, [part.name for part in model.parts])
    sections = [
        f'<div class="columns">{_section("Kinematic tree", "R turns, P slides, S is a ball joint.", tree_svg(model))}'
        f"{_section('Parts', '', parts_table(model))}</div>",
        _section(
            "Joints",
            "Axis and point in the canonical frame's coordinates, each with its spread: 68 % of the true ones lie "
            "within one, 95 % within two. The range is that of the fitted states, whose curve marks the canonical "
            "frame. Sure: from 0, where another explanation is as good, to 1.",
            joints_table(model),
        ),
        _section(
            "Residuals",
            "Root mean square distance to the nearest point, model to frame and frame to model, in % of the diagonal. "
            f"Solid: all points. Dashed: the worst part. Dotted: what sampling alone leaves, {floor:.2f} %.",
            f'<div class="wide">{curves_svg(residuals, weights, model.canonical_frame, floor)}{heat}</div>',
        ),
    ]
    if metrics is not None and metrics.parts_true is not None:
        told = f"{metrics.parts_found} parts found, {metrics.parts_true} true ones, which the view colours on demand."
        both = figures_table(metrics) + true_joints_table(metrics.joints)
        sections.append(_section("Against the truth", told, f'<div class="columns">{both}</div>'))
    return sections


def _section(title: str, words: str, body: str) -> str:
    note = f'<p class="soft">{escape(words)}</p>' if words else ""
    return f'<section class="sheet"><h2>{escape(title)}</h2>{note}{body}</section>'


def _facts(model: ModelFile) -> str:
    kinds = [joint.type for joint in model.joints]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    unit = "unit unknown" if model.units == "unknown" else f"in {LENGTH_SYMBOLS[model.units]}"
    joints = f"{counted(len(kinds), 'joint')}{f' ({counts})' if counts else ''}"
    return f"{counted(len(model.parts), 'part')} · {joints} · {counted(model.frames, 'frame')} · {unit}"


def _footer(model: ModelFile) -> str:
    return (
        f"Made by Rearticulate. All joints are at zero in frame {model.canonical_frame}, the canonical one. "
        "The view shows a choice of the points where there are very many."
    )


def _radio(group: str, value: str, words: str, chosen: bool) -> str:
    checked = " checked" if chosen else ""
    return f'<label><input type="radio" name="{group}" value="{value}"{checked}>{words}</label>'


def _colourings() -> str:
    """The choice between colours of the parts and of the scan."""
    radios = "".join(_radio("colouring", value, words, value == "part") for value, words in COLOURINGS.items())
    return f'<span class="choice" role="radiogroup" aria-label="Colours">{radios}</span>'


def _json_in_html(value: object) -> str:
    """Serialise to JSON that cannot end a script element: `<` occurs only in strings, where it is escaped."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _script(names: Sequence[str]) -> str:
    """Join the files of the script. Each may use the definitions of the files before it."""
    return "\n".join(['"use strict";', *(_resource(f"viewer/{name}") for name in names)])


def _resource(name: str) -> str:
    return files("stages.report").joinpath(name).read_text(encoding="utf-8")
