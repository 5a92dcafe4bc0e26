"""`reart fit`: fit a model to one sequence of point clouds."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pipeline.cli.options import (
    JointsOption,
    PresetOption,
    SeedOption,
    SetOption,
    WorkersOption,
    dataset_config,
    follow,
    name_failures,
    names,
    screen,
    writable_folder,
)
from pipeline.cli.run import evaluation_of, show
from pipeline.cli.tables import model_table
from pipeline.results.delivery import MESHES, RECORD, check_target, deliver
from pipeline.results.remarks import remarks, verdicts
from pipeline.run.launch import Outcome
from pipeline.run.protocol import Request
from pipeline.store import artifacts
from schemas.metrics import Metrics
from schemas.model_file import ModelFile

DATASET = "scans"


def fit(
    frames: Annotated[
        Path, typer.Argument(help="A folder of frames, meshes or depth images, or one .npy/.npz of shape (T, N, 3).")
    ],
    *,
    out: Annotated[
        Path, typer.Option(help="Where the model, robot.urdf and report.html go; artifacts go to its workdir/.")
    ],
    preset: PresetOption = None,
    units: Annotated[
        str | None, typer.Option(help="The unit of the coordinates: m, cm or mm, or in words: millimetre.")
    ] = None,
    viewpoint: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Where the camera stood that saw all frames, in their coordinates."),
    ] = None,
    truth: Annotated[Path | None, typer.Option(help="Ground truth to measure the model against.")] = None,
    own_frames: Annotated[
        bool | None,
        typer.Option(
            "--own-frames/--shared-frames",
            help="Whether each frame has coordinates of its own, as scan apps give them.",
            show_default="found out",
        ),
    ] = None,
    seed: SeedOption = None,
    joints: JointsOption = None,
    workers: WorkersOption,
    settings: SetOption,
) -> None:
    """Fit a model to one sequence of point clouds, meshes or depth images.

    Examples:

    - `reart fit scans/lamp --out models/lamp --units metre`

    - `reart fit lamp.npz --out models/lamp --set final_fit.part_price=20`

    - `reart fit scans/lamp --out models/lamp --set ingest.clean.plane=true --set ingest.clean.outliers=2`
    """
    coordinates = None if own_frames is None else "yes" if own_frames else "no"
    options = {
        "--units": ("ingest.units", units),
        "--viewpoint": ("ingest.viewpoint", names(viewpoint)),
        "--own-frames": ("alignment.own_frames", coordinates),
    }
    config = dataset_config(DATASET, preset, [*settings, "ingest.source=files"], seed, joints, options)
    request = Request(
        dataset=DATASET,
        workdir=writable_folder(out, "--out") / "workdir",
        config=config,
        frames=frames,
        truth=truth,
        workers=workers,
    )
    check_target(out)
    console, start = screen(), time.perf_counter()
    outcome = follow(request, console)
    if outcome.exit_code() == 0:
        files = delivered_files(outcome)
        deliver(out, files, obsolete=["metrics.json"])
        summarise(request, outcome, console)
        shown = dict.fromkeys(f"{MESHES}/" if name.startswith(f"{MESHES}/") else name for name in [*files, RECORD])
        written = ", ".join(str(out / name) + "/" * name.endswith("/") for name in shown)
        console.print(f"written in {time.perf_counter() - start:.1f} s: {written}", soft_wrap=True, markup=False)
    name_failures(outcome)
    raise typer.Exit(outcome.exit_code())


def directory_of(outcome: Outcome, task: str) -> Path:
    """The artifact folder of a task of the only sequence."""
    return next(place.directory for place in outcome.planned.values() if place.task == task)


def delivered_files(outcome: Outcome) -> dict[str, bytes]:
    """The delivered files by relative path. The model comes first, since `deliver` writes the first file last."""
    stages = ("result", "export", "report")
    result, exported, report = (artifacts.read_files(directory_of(outcome, stage)) for stage in stages)
    files = {name: result[name] for name in ("model.json", "model.npz")}
    metrics = artifacts.read(directory_of(outcome, "evaluation"), Metrics)
    if metrics.parts_true is not None:
        files["metrics.json"] = metrics.model_dump_json(indent=1).encode() + b"\n"
    files["report.html"] = report["report.html"]
    names = [name for name in exported if name.startswith(("robot.", f"{MESHES}/"))]
    return files | {name: exported[name] for name in sorted(names, key=lambda name: (MESHES in name, name))}


def summarise(request: Request, outcome: Outcome, console: Console) -> None:
    """Print the model, its residuals, remarks for the user, and the verdict."""
    model = artifacts.read_manifest(directory_of(outcome, "result")).payload["model"]
    console.print(model_table(ModelFile.model_validate(model)))
    energies = artifacts.read_manifest(directory_of(outcome, "canonical_frame")).payload["model"]["energies"]
    console.print("  ".join(f"{name} {value:.4g}" for name, value in energies.items()))
    show(evaluation_of(request, outcome), console)
    for _, line in remarks(outcome):
        console.print(line, soft_wrap=True, markup=False)
    for _, verdict in verdicts(outcome):
        for line in (f"trust: {verdict.trust}", *(f"- {reason}" for reason in verdict.reasons)):
            console.print(line, soft_wrap=True, markup=False)
