"""The tables of an evaluation and of a comparison, and their Markdown and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from schemas.scores import (
    MEASURES,
    ComparedFigures,
    Comparison,
    Difference,
    Figures,
    GroupScore,
    MissingScore,
    Scores,
    SequenceScore,
)

Score = SequenceScore | GroupScore

QUALITY = (
    "flagged",
    "ari",
    "told_share",
    "ari_told",
    "ri",
    "tree_edit_distance",
    "recon_cm",
    "recon_percent",
    "recon_of_motion_percent",
    "placement_percent",
    "epe_cm",
    "epe_percent",
    "epe_of_flow_percent",
    "acc5",
    "acc10",
    "reanimation_cm",
    "reanimation_percent",
    "chamfer_percent",
)
JOINTS_AND_COST = (
    "oversplit",
    "moving_joints_found",
    "axis_angle_deg",
    "axis_angle_mean_deg",
    "axis_distance_percent",
    "ball_centre_percent",
    "joint_type_accuracy",
    "within_one",
    "within_two",
    "confidence_auc",
    "seconds",
    "peak_memory_mib",
)
COMPARED = {
    "Parts and motion": (
        "parts_off",
        *(name for name in QUALITY if MEASURES[name].better and not name.endswith("_cm")),
    ),
    "Joints and cost": ("joints_found", *(name for name in JOINTS_AND_COST if MEASURES[name].better)),
}
MARKS = {"better": "▲", "worse": "▼", "same": "="}


@dataclass(frozen=True)
class Cell:
    """A cell's text and its tone, `better` or `worse`. The text states the tone too, for readers without colours."""

    text: str
    tone: str = ""


@dataclass(frozen=True)
class Row:
    """A row. A change of `section` from the row above starts a new section. `sequence` names the page to link to."""

    name: str
    cells: tuple[Cell, ...]
    section: str = ""
    sequence: str = ""


@dataclass(frozen=True)
class Table:
    """Rows under column titles. The first column holds the rows' names; the cells hold numbers, or `words`."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    words: bool = False


@dataclass(frozen=True)
class Column:
    title: str
    cell: Callable[[Score], str]


def quality_table(scores: Scores) -> Table:
    """Metrics of parts, tree and motion for every sequence, and their means."""
    columns = (Column("parts", lambda score: _share(score.figures.parts_found, score.figures.parts_true)),)
    return _score_table("Parts and motion", scores, (*columns, *map(_measure_column, QUALITY)))


def joint_table(scores: Scores) -> Table:
    """Metrics of joints, time and memory for every sequence, and their means."""
    columns = (Column("joints", lambda score: _share(score.figures.joints_found, score.figures.joints_true)),)
    return _score_table("Joints and cost", scores, (*columns, *map(_measure_column, JOINTS_AND_COST)))


def seconds_table(scores: Scores) -> Table:
    """The seconds of every stage of every sequence, summed over its candidates."""

    def column(stage: str) -> Column:
        return Column(f"{stage} s", lambda s: f"{s.costs[stage].seconds:.1f}" if stage in s.costs else "-")

    return _score_table("Seconds of each stage", scores, tuple(map(column, _stages(scores))))


def memory_table(scores: Scores) -> Table:
    """The peak memory of every stage of every sequence."""

    def column(stage: str) -> Column:
        return Column(f"{stage} MiB", lambda s: number(s.costs[stage].peak_memory_mib, 0) if stage in s.costs else "-")

    return _score_table("Peak memory of each stage", scores, tuple(map(column, _stages(scores))))


def stage_table(scores: Scores) -> Table:
    """The stages' mean seconds, their share of all, and the most memory that any sequence took."""
    everything = next((group.costs for group in scores.groups if group.level == "all"), {})
    total = sum(cost.seconds for cost in everything.values())
    rows = []
    for stage, mean in everything.items():
        peaks = [score.costs[stage].peak_memory_mib for score in scores.sequences if stage in score.costs]
        highest = max((peak for peak in peaks if peak is not None), default=None)
        texts = (f"{mean.seconds:.1f}", f"{mean.seconds / total:.1%}" if total else "-", number(highest, 0))
        rows.append(Row(stage, tuple(map(Cell, texts))))
    return Table("Stages", ("stage", "mean s", "share", "peak MiB"), tuple(rows))


def missing_table(missing: Sequence[MissingScore]) -> Table:
    """The sequences without an evaluation, each with the reason."""
    rows = tuple(
        Row(entry.sequence, (Cell(entry.state, "worse"), Cell(entry.message), Cell(entry.log or "-")))
        for entry in missing
    )
    return Table("Not evaluated", ("sequence", "state", "why", "log"), rows, words=True)


def brief_tables(scores: Scores) -> list[Table]:
    """The tables for the screen, the most important last."""
    tables = [stage_table(scores), joint_table(scores), quality_table(scores)]
    return [table for table in tables if table.rows]


def full_tables(scores: Scores) -> list[Table]:
    """The tables for a document, the most important first."""
    tables = [
        quality_table(scores),
        missing_table(scores.missing),
        joint_table(scores),
        stage_table(scores),
        seconds_table(scores),
        memory_table(scores),
    ]
    return [table for table in tables if table.rows]


def comparison_tables(comparison: Comparison) -> list[Table]:
    """Both values and the difference of each metric, for each sequence and then for the means."""
    tables = [_change_table(title, comparison, names) for title, names in COMPARED.items()]
    if comparison.mean is not None:
        rows = tuple(_mean_row(name, difference) for name, difference in comparison.mean.differences.items())
        columns = ("figure", "before", "after", "change", "verdict")
        tables.append(Table(f"Changes of the {comparison.mean.name} since {comparison.before}", columns, rows))
    return [table for table in tables if table.rows]


def _change_table(title: str, comparison: Comparison, names: Sequence[str]) -> Table:
    told = [name for name in names if any(name in entry.differences for entry in comparison.sequences)]
    rows = tuple(
        Row(entry.name, tuple(_change(entry, name) for name in told), sequence=entry.name)
        for entry in comparison.sequences
    )
    legend = ", ".join(f"{mark} {verdict}" for verdict, mark in MARKS.items())
    return Table(f"Changes: {title} ({legend})", ("sequence", *map(column_title, told)), rows)


def to_markdown(table: Table) -> str:
    """Format a table as Markdown, with means in bold."""
    rules = ["---", *("---" if table.words else "---:" for _ in table.columns[1:])]
    lines = [f"### {table.title}", "", _line(table.columns), _line(rules)]
    for row in table.rows:
        name = f"**{row.name}**" if row.section else row.name
        lines.append(_line([name, *(cell.text for cell in row.cells)]))
    return "\n".join(lines) + "\n"


def to_csv(scores: Scores) -> str:
    """Format all sequences and means as CSV, one line each. Metrics are unrounded; unknown ones are empty."""
    stages = _stages(scores)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    costs = [f"{stage}_{what}" for stage in stages for what in ("seconds", "peak_memory_mib")]
    writer.writerow(["level", "name", "robot", "type", "split", "sequences", *MEASURES, *costs])
    for score in scores.sequences:
        origin = [score.robot, score.type, score.split]
        writer.writerow(["sequence", score.sequence, *origin, 1, *_values(score, stages)])
    for group in scores.groups:
        writer.writerow([group.level, group.name, None, None, None, group.sequences, *_values(group, stages)])
    return text.getvalue()


def column_title(name: str) -> str:
    """A measure's title with its unit."""
    measure = MEASURES[name]
    return f"{measure.title} {measure.unit}".strip()


def number(value: float | None, decimals: int) -> str:
    """Format a rounded number. With one decimal, a whole number is written without it."""
    if value is None:
        return "-"
    text = f"{value:.{decimals}f}"
    return text.removesuffix(".0") if decimals == 1 else text


def _score_table(title: str, scores: Scores, columns: Sequence[Column]) -> Table:
    """A row for each sequence and for each group of `_shown_groups`, without columns that have no values."""
    found: list[tuple[str, str, str, Score]] = [(s.sequence, "", s.sequence, s) for s in scores.sequences]
    found += [(_group_name(group), group.level, "", group) for group in _shown_groups(scores)]
    texts = [[column.cell(score) for column in columns] for *_, score in found]
    told = [i for i in range(len(columns)) if any(row[i] != "-" for row in texts)]
    rows = tuple(
        Row(name, tuple(Cell(row[i]) for i in told), section, sequence)
        for (name, section, sequence, _), row in zip(found, texts, strict=True)
    )
    return Table(title, ("sequence", *(columns[i].title for i in told)), rows)


def _shown_groups(scores: Scores) -> Iterator[GroupScore]:
    """The groups whose means add something: none for one sequence, and no robots if each has one sequence."""
    if len(scores.sequences) < 2:
        return
    several = any(group.level == "robot" and group.sequences > 1 for group in scores.groups)
    for group in scores.groups:
        if group.level != "robot" or several:
            yield group


def _group_name(group: GroupScore) -> str:
    return f"mean ({group.sequences})" if group.level == "all" else f"{group.level} {group.name} ({group.sequences})"


def _measure_column(name: str) -> Column:
    return Column(column_title(name), lambda score: number(getattr(score.figures, name), MEASURES[name].decimals))


def _share(found: float | None, true: float | None) -> str:
    return number(found, 1) if true is None else f"{number(found, 1)}/{number(true, 1)}"


def _change(entry: ComparedFigures, name: str) -> Cell:
    if name not in entry.differences:
        return Cell("-")
    difference = entry.differences[name]
    return Cell(
        f"{signed(difference, name)} {MARKS.get(difference.verdict or '', '')}".rstrip(), difference.verdict or ""
    )


def _mean_row(name: str, difference: Difference) -> Row:
    decimals = MEASURES[name].decimals
    texts = (number(difference.before, decimals), number(difference.after, decimals), signed(difference, name))
    verdict = difference.verdict
    last = Cell(f"{MARKS[verdict]} {verdict}", verdict) if verdict else Cell("-")
    return Row(column_title(name), (*map(Cell, texts), last))


def signed(difference: Difference, name: str) -> str:
    """Format a change with its sign, or without one if it rounds to zero."""
    text = number(difference.change, MEASURES[name].decimals)
    if not text.strip("-0."):
        return text.lstrip("-")
    return text if difference.change < 0 else f"+{text}"


def _stages(scores: Scores) -> list[str]:
    return list(dict.fromkeys(stage for score in scores.sequences for stage in score.costs))


def _values(score: Score, stages: Sequence[str]) -> list[float | None]:
    figures: Figures = score.figures
    costs = [score.costs.get(stage) for stage in stages]
    of_stages = [value for cost in costs for value in ((cost.seconds, cost.peak_memory_mib) if cost else (None, None))]
    return [*(getattr(figures, name) for name in MEASURES), *of_stages]


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
