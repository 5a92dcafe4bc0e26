"""`reart fit`: one sequence of point clouds to a model."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pipeline import store
from pipeline.cli.options import (
    PresetOption,
    SeedOption,
    SetOption,
    WorkersOption,
    dataset_config,
    follow,
    name_failures,
    screen,
    writable_folder,
)
from pipeline.cli.run import evaluation_of, show
from pipeline.cli.tables import model_table
from pipeline.files import write_atomically
from pipeline.launch import Outcome
from pipeline.model_folder import write_robot
from pipeline.protocol import Request
from schemas.metrics import Metrics
from schemas.model_file import ModelFile

DATASET = "scans"


def fit(
    frames: Annotated[Path, typer.Argument(help="A folder of frames, or one .npy/.npz of shape (T, N, 3).")],
    *,
    out: Annotated[
        Path, typer.Option(help="Where the model, robot.urdf and report.html go; artifacts go to its workdir/.")
    ],
    preset: PresetOption = None,
    units: Annotated[
        str | None, typer.Option(help="The unit of the coordinates: metre, centimetre or millimetre.")
    ] = None,
    truth: Annotated[Path | None, typer.Option(help="Ground truth to measure the model against.")] = None,
    seed: SeedOption = None,
    workers: WorkersOption,
    settings: SetOption,
) -> None:
    """Fit a model to one sequence of point clouds.

    Examples:

    - `reart fit scans/lamp --out models/lamp --units metre`

    - `reart fit lamp.npz --out models/lamp --set final_fit.part_price=20`
    """
    options = {"--units": ("ingest.units", units)}
    config = dataset_config(DATASET, preset, [*settings, "ingest.source=files"], seed, options)
    request = Request(
        dataset=DATASET,
        workdir=writable_folder(out, "--out") / "workdir",
        config=config,
        frames=frames,
        truth=truth,
        workers=workers,
    )
    console, start = screen(), time.perf_counter()
    outcome = follow(request, console)
    if outcome.exit_code() == 0:
        deliver(outcome, out)
        summarise(request, outcome, out, time.perf_counter() - start, console)
    name_failures(outcome)
    raise typer.Exit(outcome.exit_code())


def directory_of(outcome: Outcome, task: str) -> Path:
    """The artifact of a task of the only sequence."""
    return next(place.directory for place in outcome.planned.values() if place.task == task)


def deliver(outcome: Outcome, out: Path) -> None:
    """Put the result's files where the user wants them, each whole or not at all."""
    stages = ("result", "export", "report")
    result, exported, report = (store.read_files(directory_of(outcome, stage)) for stage in stages)
    for name in ("model.npz", "model.json"):
        write_atomically(out / name, result[name])
    names = [name for name in exported if name.startswith(("robot.", "meshes/"))]
    write_robot(out, {name: exported[name] for name in sorted(names, reverse=True)})  # meshes last: written first
    write_atomically(out / "report.html", report["report.html"])
    metrics = store.read(directory_of(outcome, "evaluation"), Metrics)
    if metrics.parts_true is not None:
        write_atomically(out / "metrics.json", metrics.model_dump_json(indent=1).encode() + b"\n")
    else:
        (out / "metrics.json").unlink(missing_ok=True)  # an earlier fit's


def summarise(request: Request, outcome: Outcome, out: Path, seconds: float, console: Console) -> None:
    """Say what was found, how well it fits, and where it is."""
    console.print(model_table(ModelFile.model_validate_json((out / "model.json").read_bytes())))
    energies = store.read_manifest(directory_of(outcome, "canonical_frame")).payload["model"]["energies"]
    console.print("  ".join(f"{name} {value:.4g}" for name, value in energies.items()))
    show(evaluation_of(request, outcome), console)
    files = ("model.json", "model.npz", "robot.urdf", "metrics.json", "report.html")
    written = [out / file for file in files if (out / file).exists()]
    console.print(f"written in {seconds:.1f} s: {', '.join(map(str, written))}", soft_wrap=True)
