"""Tables for the screen."""

from __future__ import annotations

from collections.abc import Mapping

from rich.table import Table

from schemas.metrics import Metrics
from schemas.model_file import ModelFile

LENGTH_NAMES = {"metre": "m", "centimetre": "cm", "millimetre": "mm", "unknown": "input units"}
CENTIMETRES = {"metre": 100.0, "centimetre": 1.0, "millimetre": 0.1}


def model_table(model: ModelFile) -> Table:
    """A line a joint."""
    table = Table("joint", "parent", "child", "type", "axis", "range", title=f"{len(model.parts)} parts")
    for joint in model.joints:
        unit = LENGTH_NAMES[model.units] if joint.type == "prismatic" else "rad"
        table.add_row(
            joint.name,
            model.parts[joint.parent].name,
            model.parts[joint.child].name,
            joint.type,
            " ".join(f"{value:.3f}" for value in joint.axis),
            f"{joint.lower + 0.0:.3g} .. {joint.upper + 0.0:.3g} {unit}",  # + 0.0: no "-0"
        )
    return table


def metrics_table(metrics: Mapping[str, Metrics], seconds: Mapping[str, float]) -> Table:
    """A line a sequence; lengths in centimetres where the unit is known, else in % of the diagonal."""
    names = ("ARI", "RI", "TED", "recon", "EPE", "acc5", "acc10", "reanimation", "Chamfer", "seconds")
    table = Table("sequence", "parts")
    for name in names:
        table.add_column(name, justify="right")
    for sequence, m in metrics.items():
        scale = CENTIMETRES.get(m.units)
        table.add_row(
            sequence,
            f"{m.parts_found}" if m.parts_true is None else f"{m.parts_found}/{m.parts_true}",
            _number(m.ari),
            _number(m.ri),
            "-" if m.tree_edit_distance is None else str(m.tree_edit_distance),
            _length(m.recon, m.recon_percent, scale),
            _length(m.epe, m.epe_percent, scale),
            _number(m.acc5),
            _number(m.acc10),
            _length(m.reanimation, m.reanimation_percent, scale),
            f"{m.chamfer_percent:.3f} %",
            f"{seconds[sequence]:.0f}",
        )
    return table


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _length(value: float | None, percent: float | None, centimetres: float | None) -> str:
    if value is None or percent is None:
        return "-"
    return f"{percent:.3f} %" if centimetres is None else f"{value * centimetres:.3f} cm"
