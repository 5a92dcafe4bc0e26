"""Tables for the screen."""

from __future__ import annotations

import math

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from pipeline.results import report_tables
from schemas.assessment import Spread
from schemas.model_file import ModelFile, ModelJoint
from schemas.sequence import LENGTH_SYMBOLS

COLOURS = {"better": "green", "worse": "red"}


def model_table(model: ModelFile) -> Table:
    """A table with one row for each joint."""
    title = f"{len(model.parts)} part{'' if len(model.parts) == 1 else 's'}"
    table = Table("joint", "parent", "child", "type", "axis", "range", "spread", title=title)
    for joint in model.joints:
        table.add_row(
            *map(escape, (joint.name, model.parts[joint.parent].name, model.parts[joint.child].name)),
            joint.type,
            " ".join(f"{value:.3f}" for value in joint.axis),
            observed_range(joint, LENGTH_SYMBOLS[model.units]),
            spread(joint, LENGTH_SYMBOLS[model.units]),
        )
    return table


def spread(joint: ModelJoint, length: str) -> str:
    """Format how exactly a joint's axis is known: its direction in degrees, its place with the symbol of lengths."""
    known = joint.spread or Spread()
    direction = [] if known.direction is None else [f"{math.degrees(known.direction):.2g}°"]
    place = [] if known.place is None else [f"{known.place:.2g} {length}"]
    return ", ".join(direction + place)


def observed_range(joint: ModelJoint, length: str) -> str:
    """Format the limits of a joint with their units. `length` is the unit symbol of lengths."""
    ranges = joint.ranges(length)
    return ", ".join(f"{low + 0.0:.3g} .. {high + 0.0:.3g} {unit}" for low, high, unit in ranges)  # + 0.0: no "-0"


def screen_table(table: report_tables.Table) -> Table:
    """Render a table of the evaluation for the screen, with a line between its sections."""
    shown = Table(table.columns[0], title=table.title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    for title in table.columns[1:]:
        shown.add_column(title, justify="left" if table.words else "right")
    section = ""
    for row in table.rows:
        if row.section != section:
            shown.add_section()
            section = row.section
        shown.add_row(escape(row.name), *map(_coloured, row.cells))
    return shown


def _coloured(cell: report_tables.Cell) -> str:
    colour = COLOURS.get(cell.tone)
    return f"[{colour}]{escape(cell.text)}[/]" if colour else escape(cell.text)
