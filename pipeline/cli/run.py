"""`reart run`: fit models to the sequences of a data set."""

from __future__ import annotations

import sys
from pathlib import Path

import typer
from rich.console import Console

from pipeline.cli.options import (
    DataOption,
    DatasetOption,
    JointsOption,
    PresetOption,
    SeedOption,
    SequencesOption,
    SetOption,
    WorkdirOption,
    WorkersOption,
    dataset_config,
    follow,
    name_failures,
    names,
    screen,
    writable_folder,
)
from pipeline.cli.tables import screen_table
from pipeline.results.evaluation_files import PAGES, default_folder, write_evaluation
from pipeline.results.remarks import remarks, verdicts
from pipeline.results.report_tables import brief_tables
from pipeline.run.launch import FAILED, Outcome
from pipeline.run.protocol import Request
from pipeline.store import artifacts
from pipeline.store.files import check_own_folder
from schemas.scores import MissingScore, Scores


def run(
    *,
    dataset: DatasetOption,
    sequences: SequencesOption = None,
    data: DataOption = None,
    workdir: WorkdirOption = Path("workdir"),
    preset: PresetOption = None,
    seed: SeedOption = None,
    joints: JointsOption = None,
    workers: WorkersOption,
    settings: SetOption,
) -> None:
    """Fit a model to every sequence of a data set. Complete artifacts are not computed again.

    At the end, WORKDIR/DATASET/evaluation holds the evaluation of these sequences, as `reart evaluate` writes it.

    Examples:

    - `reart run --dataset roboart --sequences bolt,ur5`

    - `reart run --dataset scans --data my_scans --set final_fit.part_price=20`
    """
    request = Request(
        dataset=dataset,
        workdir=writable_folder(workdir, "--workdir"),
        config=dataset_config(dataset, preset, settings, seed, joints),
        data=data,
        sequences=names(sequences),
        workers=workers,
    )
    finish(request, write=True)


def finish(request: Request, write: bool = False) -> None:
    """Run a request, show the evaluation of its complete sequences, and exit. `write` also writes its files."""
    if write:
        check_own_folder(default_folder(request) / PAGES)  # before hours of computing
    console = screen()
    outcome = follow(request, console)
    unsound = unsound_results(outcome)
    try:
        if outcome.planned:
            conclude(request, outcome, console, write)
    finally:  # even if the evaluation cannot be written
        name_failures(outcome)
        for error in unsound:
            print(f"error: {error}", file=sys.stderr)
    raise typer.Exit(outcome.exit_code() or (FAILED if unsound else 0))


def conclude(request: Request, outcome: Outcome, console: Console, write: bool) -> None:
    """Show the evaluation of a run and remarks for the user. `write` also writes the evaluation's files."""
    scores = evaluation_of(request, outcome)
    show(scores, console)
    for sequence, line in remarks(outcome):
        console.print(f"{sequence}: {line}", soft_wrap=True, markup=False)
    for sequence, verdict in verdicts(outcome):
        if verdict.trust != "good":
            console.print(f"{sequence}: {verdict.trust}: {'; '.join(verdict.reasons)}", soft_wrap=True, markup=False)
    if write:
        folder = default_folder(request)
        write_evaluation(scores, request.workdir, folder)
        console.print(f"written: {folder / 'index.html'}", soft_wrap=True, markup=False)


def unsound_results(outcome: Outcome) -> list[artifacts.ArtifactError]:
    """The problems of the files of a run's final artifacts. Every byte of them is read."""
    from pipeline.run.tasks import FINAL

    ends = {task.stage for task in FINAL}
    unsound = []
    for place in outcome.planned.values():
        if place.stage in ends and outcome.is_complete(place):
            try:
                artifacts.read_files(place.directory)
            except artifacts.ArtifactError as error:
                unsound.append(error)
    return unsound


def evaluation_of(request: Request, outcome: Outcome) -> Scores:
    """The evaluation of a run's planned sequences, from the artifacts on the disk. No input is read again."""
    from pipeline.results.scores import PlannedSequence, scores_of

    planned = [PlannedSequence(name, origin, outcome.places_of(name)) for name, origin in outcome.origins.items()]
    missing = [
        MissingScore(sequence=name, state="failed", message=failure.message)
        for (name, _), failure in outcome.failures.items()
        if name not in outcome.origins
    ]
    missing += [
        MissingScore(sequence=name, state="unavailable", message=message)
        for name, message in outcome.unavailable.items()
    ]
    return scores_of(request, planned, missing)


def show(scores: Scores, console: Console) -> None:
    """Print the brief tables, if there is anything to show."""
    for table in brief_tables(scores):
        console.print(screen_table(table))
