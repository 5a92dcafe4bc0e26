"""`reart run`: the sequences of a data set."""

from __future__ import annotations

from pathlib import Path

import typer
from rich.console import Console

from pipeline.cli.options import (
    DataOption,
    DatasetOption,
    PresetOption,
    SeedOption,
    SequencesOption,
    SetOption,
    WorkdirOption,
    WorkersOption,
    dataset_config,
    follow,
    name_failures,
    screen,
    sequence_names,
    writable_folder,
)
from pipeline.cli.tables import screen_table
from pipeline.launch import Outcome
from pipeline.protocol import Request
from pipeline.remarks import remarks
from pipeline.report_tables import brief_tables
from schemas.scores import MissingScore, Scores


def run(
    *,
    dataset: DatasetOption,
    sequences: SequencesOption = None,
    data: DataOption = None,
    workdir: WorkdirOption = Path("workdir"),
    preset: PresetOption = None,
    seed: SeedOption = None,
    workers: WorkersOption,
    settings: SetOption,
) -> None:
    """Fit a model to every sequence of a data set. What is complete is not computed again.

    Ends with the evaluation of these sequences, as `reart evaluate` writes it, in WORKDIR/DATASET/evaluation.

    Examples:

    - `reart run --dataset roboart --sequences bolt,ur5`

    - `reart run --dataset scans --data my_scans --set final_fit.part_price=20`
    """
    request = Request(
        dataset=dataset,
        workdir=writable_folder(workdir, "--workdir"),
        config=dataset_config(dataset, preset, settings, seed),
        data=data,
        sequences=sequence_names(sequences),
        workers=workers,
    )
    finish(request, write=True)


def finish(request: Request, write: bool = False) -> None:
    """Run a request to its end, show the evaluation of what is complete, and exit; `write` its files too."""
    console = screen()
    outcome = follow(request, console)
    if outcome.planned:
        scores = evaluation_of(request, outcome)
        show(scores, console)
        for sequence, line in remarks(outcome):
            console.print(f"{sequence}: {line}", soft_wrap=True, markup=False)
        if write:
            from pipeline.evaluation_files import default_folder, write_evaluation

            folder = default_folder(request)
            write_evaluation(scores, request.workdir, folder)
            console.print(f"written: {folder / 'index.html'}", soft_wrap=True, markup=False)
    name_failures(outcome)
    raise typer.Exit(outcome.exit_code())


def evaluation_of(request: Request, outcome: Outcome) -> Scores:
    """The evaluation of what a run was to make; what it could not get is not sought once more."""
    from pipeline.scores import gather

    sought = dict.fromkeys(sequence for sequence, _ in (*outcome.planned, *outcome.failures))
    only = {"rerun": None} if request.frames else {"rerun": None, "sequences": tuple(sought)}
    scores = gather(request.model_copy(update=only))
    unavailable = tuple(
        MissingScore(sequence=name, state="unavailable", message=message)
        for name, message in outcome.unavailable.items()
    )
    return scores.model_copy(update={"missing": scores.missing + unavailable})


def show(scores: Scores, console: Console) -> None:
    """The tables for the screen, where there is anything to show."""
    for table in brief_tables(scores):
        console.print(screen_table(table))
