"""`reart evaluate`: tables of a data set from its existing evaluations."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pipeline.cli.options import (
    DataOption,
    DatasetOption,
    JointsOption,
    JsonOption,
    PresetOption,
    SeedOption,
    SequencesOption,
    SetOption,
    WorkdirOption,
    dataset_config,
    names,
    screen,
    writable_folder,
)
from pipeline.cli.run import show
from pipeline.cli.tables import screen_table
from pipeline.results.report_tables import comparison_tables
from pipeline.run.protocol import Request
from schemas.scores import Comparison, MissingScore


def evaluate(
    *,
    dataset: DatasetOption,
    split: Annotated[str | None, typer.Option(help="Only the robots of this split: train, validation or test.")] = None,
    sequences: SequencesOption = None,
    data: DataOption = None,
    workdir: WorkdirOption = Path("workdir"),
    preset: PresetOption = None,
    seed: SeedOption = None,
    joints: JointsOption = None,
    settings: SetOption,
    out: Annotated[
        Path | None, typer.Option(help="Where the files go.", show_default="WORKDIR/DATASET/evaluation")
    ] = None,
    against: Annotated[
        Path | None, typer.Option(help="An earlier evaluation.json: show what got better or worse since.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show the evaluation of a data set, by sequence, robot type and split; write it as JSON, Markdown, CSV and HTML.

    Nothing is computed. Sequences without an evaluation for these settings are named, and the exit code is then 1.
    Sequences that this machine cannot get are named too, but only count if --sequences asks for them. With --against,
    --json prints the comparison.

    Examples:

    - `reart evaluate --dataset roboart --split test`

    - `reart evaluate --dataset roboart --against earlier/evaluation.json`
    """
    from pipeline.results.comparison import compare
    from pipeline.results.evaluation_files import default_folder, write_evaluation
    from pipeline.results.scores import gather, read_scores

    earlier = None if against is None else read_scores(against)  # first, since this run may overwrite it
    request = Request(
        dataset=dataset,
        workdir=workdir,
        config=dataset_config(dataset, preset, settings, seed, joints),
        data=data,
        sequences=names(sequences),
    )
    scores = gather(request, split)
    comparison = None if earlier is None else compare(earlier, scores, str(against))
    folder = writable_folder(out or default_folder(request), "--out")
    write_evaluation(scores, workdir, folder, comparison)
    if as_json:
        print((comparison or scores).model_dump_json(indent=1))
    else:
        console = screen()
        show(scores, console)
        if comparison is not None:
            show_comparison(comparison, console)
        console.print(f"written: {folder / 'index.html'}", soft_wrap=True, markup=False)
    name_missing(scores.missing)
    raise typer.Exit(1 if any(entry.state != "unavailable" for entry in scores.missing) else 0)


def show_comparison(comparison: Comparison, console: Console) -> None:
    """Print the differences, the changed settings, and the sequences that only one evaluation has."""
    for table in comparison_tables(comparison):
        console.print(screen_table(table))
    for words, listed in (
        ("settings that differ", comparison.settings),
        ("only before", comparison.only_before),
        ("only now", comparison.only_after),
    ):
        if listed:
            console.print(f"{words}: {', '.join(listed)}", soft_wrap=True, markup=False)


def name_missing(missing: tuple[MissingScore, ...]) -> None:
    """Name on standard error the sequences without an evaluation, each with the reason and the log."""
    for entry in missing:
        log = f" (log: {entry.log})" if entry.log else ""
        print(f"{entry.sequence} {entry.state}: {entry.message}{log}", file=sys.stderr)
