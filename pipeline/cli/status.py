"""`reart status`: the state of every stage of every sequence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pipeline.cli.options import (
    DataOption,
    DatasetOption,
    JointsOption,
    JsonOption,
    PresetOption,
    SeedOption,
    SetOption,
    WorkdirOption,
    dataset_config,
    screen,
)
from pipeline.run.protocol import Request

if TYPE_CHECKING:
    from pipeline.results.status import TaskStatus

COLOURS = {"corrupt": "red", "unreadable": "red", "failed": "red", "stale": "yellow", "missing": "dim"}  # worst first


def status(
    *,
    dataset: DatasetOption = "roboart",
    data: DataOption = None,
    workdir: WorkdirOption = Path("workdir"),
    preset: PresetOption = None,
    seed: SeedOption = None,
    joints: JointsOption = None,
    settings: SetOption,
    check: Annotated[bool, typer.Option("--check", help="Read every artifact whole, not only its manifest.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Show which stages are done, failed (and why), stale (made with other settings only) or missing.

    With --check the exit code is 1 if any artifact is corrupt or cannot be read.

    Examples:

    - `reart status`

    - `reart status --dataset scans --data my_scans --check --json`
    """
    from pipeline.results.status import collect

    request = Request(
        dataset=dataset, workdir=workdir, config=dataset_config(dataset, preset, settings, seed, joints), data=data
    )
    tasks = collect(request, check)
    if as_json:
        print(f"[{', '.join(task.model_dump_json() for task in tasks)}]")
    else:
        show(tasks, screen())
    if check and any(task.state in ("corrupt", "unreadable") for task in tasks):
        raise typer.Exit(1)


def show(tasks: Sequence[TaskStatus], console: Console) -> None:
    """Print a row for each sequence with a column for each stage, and the failures below."""
    cells: dict[str, dict[str, list[TaskStatus]]] = {}
    for task in tasks:
        cells.setdefault(task.sequence, {}).setdefault(task.stage, []).append(task)
    stages = dict.fromkeys(task.stage for task in tasks)
    table = Table("sequence", *stages)
    for sequence, row in cells.items():
        table.add_row(sequence, *(_cell(row.get(stage, [])) for stage in stages))
    console.print(table)
    for task in tasks:
        if task.message:
            log = f" (log: {task.log})" if task.log else ""
            console.print(f"{task.sequence} {task.task} {task.state}: {escape(task.message)}{log}", soft_wrap=True)


def _cell(tasks: list[TaskStatus]) -> str:
    """The cell of one stage of one sequence: the worst state of its tasks, or their seconds."""
    done = [task for task in tasks if task.state == "done"]
    if len(done) == len(tasks):
        return f"{sum(task.seconds or 0 for task in done):.1f} s" if done else "-"
    worst = next(state for state in COLOURS if any(task.state == state for task in tasks))
    share = f" ({len(done)}/{len(tasks)} done)" if done else ""
    return f"[{COLOURS[worst]}]{worst}[/]{share}"
