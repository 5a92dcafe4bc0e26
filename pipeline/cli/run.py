"""`reart run`: the sequences of a data set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pipeline import store
from pipeline.cli.options import (
    DataOption,
    DatasetOption,
    PresetOption,
    SeedOption,
    SetOption,
    WorkdirOption,
    WorkersOption,
    dataset_config,
    follow,
    name_failures,
    screen,
    writable_folder,
)
from pipeline.cli.tables import metrics_table
from pipeline.launch import Outcome
from pipeline.protocol import Request
from schemas.metrics import Metrics


def run(
    *,
    dataset: DatasetOption,
    sequences: Annotated[str | None, typer.Option(help="Only these, as in `bolt,ur5`; default: all.")] = None,
    data: DataOption = None,
    workdir: WorkdirOption = Path("workdir"),
    preset: PresetOption = None,
    seed: SeedOption = None,
    workers: WorkersOption,
    settings: SetOption,
) -> None:
    """Fit a model to every sequence of a data set. What is complete is not computed again.

    Examples:

    - `reart run --dataset roboart --sequences bolt,ur5`

    - `reart run --dataset scans --data my_scans --set final_fit.iterations=500`
    """
    request = Request(
        dataset=dataset,
        workdir=writable_folder(workdir, "--workdir"),
        config=dataset_config(dataset, preset, settings, seed),
        data=data,
        sequences=None if sequences is None else tuple(name.strip() for name in sequences.split(",") if name.strip()),
        workers=workers,
    )
    finish(request)


def finish(request: Request) -> None:
    """Run a request to its end, show the metrics of what is complete, and exit."""
    console = screen()
    outcome = follow(request, console)
    show_metrics(outcome, console)
    name_failures(outcome)
    raise typer.Exit(outcome.exit_code())


def show_metrics(outcome: Outcome, console: Console) -> None:
    """A line for every complete sequence; seconds are those spent on all its stages."""
    metrics, seconds = {}, {}
    incomplete = {sequence for sequence, _ in outcome.incomplete()}
    for (sequence, task), directory in outcome.planned.items():
        if task == "evaluation" and sequence not in incomplete:
            metrics[sequence] = store.read(directory, Metrics)
            stages = [path for (name, _), path in outcome.planned.items() if name == sequence]
            seconds[sequence] = sum(sum(store.read_manifest(path).seconds.values()) for path in stages)
    if metrics:
        console.print(metrics_table(metrics, seconds))
