"""`reart export`: a model as a robot description."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import ModelArgument, SetOption, naming, writable_folder
from pipeline.configuration.presets import load_config
from pipeline.results.delivery import check_target, deliver
from pipeline.results.model_folder import ingested_of_model, read_model_folder
from schemas.errors import InputError

FORMATS = ("urdf", "mjcf")


def export(
    model: ModelArgument,
    *,
    to: Annotated[str, typer.Option(help="The format: urdf, or mjcf for MuJoCo.")],
    out: Annotated[
        Path | None, typer.Option(help="Where the description and its meshes/ go.", show_default="MODEL")
    ] = None,
    scale: Annotated[
        float | None, typer.Option(help="Metres per unit of the model's coordinates.", show_default="by its unit, or 1")
    ] = None,
    mesh: Annotated[
        str | None, typer.Option(help="A part's visible mesh: closed (what its points enclose) or hull.")
    ] = None,
    collision: Annotated[
        str | None, typer.Option(help="A part's collision mesh: hull, or coacd (several, by that package).")
    ] = None,
    settings: SetOption,
) -> None:
    """Write a model as URDF or MJCF, with a mesh, mass and inertia for every part and limits for every joint.

    Meshes are made from the points of all frames if the fit's artifacts still exist, else from the canonical frame.

    Examples:

    - `reart export models/lamp --to urdf`

    - `reart export models/lamp --to mjcf --scale 0.001 --out lamp_mujoco --set export.density=500`
    """
    if to not in FORMATS:
        raise InputError(f"--to: found {to!r}, expected one of {', '.join(FORMATS)}")
    options = {
        "--scale": ("export.metres_per_unit", scale),
        "--mesh": ("export.surface", mesh),
        "--collision": ("export.collision", collision),
    }
    config = load_config(["scans"], settings, options).export
    result = read_model_folder(model)
    folder = writable_folder(out or model, "--out")
    check_target(folder)
    from stages.export.stage import WRITERS, check_exportable, compute_export  # Open3D takes seconds to import

    with naming(model):
        check_exportable(result)
    ingested = ingested_of_model(model, result)
    frames, colours = (None, None) if ingested is None else ingested.sequence.in_input()
    robot = compute_export(result, frames, config, model.resolve().name, colours)
    files = WRITERS[to](robot)
    deliver(folder, files)
    what = f"{len(frames)} frames" if frames else "the canonical frame only"
    typer.echo(f"{len(robot.links)} links, {len(robot.joints)} joints; meshes of the points of {what}")
    for line in robot.remarks:
        typer.echo(line)
    if robot.units == "unknown" and config.metres_per_unit is None:
        typer.echo("the model's unit is unknown: one unit was taken for one metre; say otherwise by --scale")
    if open_meshes := [entry.file for entry in robot.meshes if not entry.closed]:
        typer.echo(f"not closed: {', '.join(open_meshes)}")
    typer.echo(f"written: {folder / next(iter(files))}")
