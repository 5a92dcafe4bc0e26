"""`reart pose`: put a model into a new pose."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pipeline.cli.options import JsonOption, ModelArgument, naming, screen, writable_folder
from pipeline.cli.tables import observed_range
from pipeline.results.model_folder import read_model_folder
from pipeline.store.files import write_files
from schemas.errors import InputError
from schemas.model_file import ModelFile
from schemas.pose import Pose
from schemas.sequence import LENGTH_SYMBOLS


def pose(
    model: ModelArgument,
    *,
    targets: Annotated[
        Path | None,
        typer.Option(
            help="Points of the canonical frame and their targets, at least one pair: .csv with the columns "
            "source_x, source_y, source_z, target_x, target_y, target_z; .json or .npz with source and target, (N, 3)."
        ),
    ] = None,
    states: Annotated[
        Path | None,
        typer.Option(
            help="Joint states: .json {joint: state}, .csv with the columns name,value, or a pose.json. "
            "Joints that are not named stay as in the canonical frame."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Where posed.ply and pose.json go; without it nothing is written.")
    ] = None,
    limits: Annotated[
        bool | None,
        typer.Option(
            "--limits/--no-limits",
            help="Keep to the joints' observed ranges, lower to upper.",
            show_default="states must, targets may lead beyond",
        ),
    ] = None,
    free_base: Annotated[
        bool | None,
        typer.Option(
            "--free-base/--fixed-base",
            help="Whether targets may move the whole object, too.",
            show_default="where it moved in the sequence",
        ),
    ] = None,
    colours: Annotated[
        str | None,
        typer.Option(
            help="The colours of the points of posed.ply: by part, or of the scan.",
            show_default="scan where it has colours",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Pose a model by given joint states, or so that given points of it come closest to their targets.

    Lengths are in the model's units, angles in radians. Joints that the targets do not determine are named. They stay
    as in the nearest observed frame.

    Examples:

    - `reart pose models/lamp --targets grasp.csv --out posed`

    - `reart pose models/lamp --states posed/pose.json --json`
    """
    if (targets is None) == (states is None):
        found = "neither" if targets is None else "both"
        raise InputError(f"--targets, --states: found {found}, expected exactly one of them; give one")
    if states is not None and free_base is not None:
        raise InputError("--free-base, --fixed-base: found with --states, expected with --targets; leave it out")
    result = read_model_folder(model)
    if colours not in (None, "part", "scan"):
        raise InputError(f"--colours: found {colours!r}, expected part or scan")
    if colours == "scan" and result.colours is None:
        raise InputError(f"--colours scan: {model} was fitted to scans without colours; take part")
    if out is not None:
        writable_folder(out, "--out")
    from pipeline.results.pose_files import pose_files, read_states, read_targets
    from stages.rearticulation.posing import pose_by_states, pose_by_targets

    if targets is not None:
        source, target = read_targets(targets)
        with naming(targets):
            posed = pose_by_targets(result, source, target, limits=limits or False, free_base=free_base)
    if states is not None:
        given, T_pose_root = read_states(states, result.model)
        with naming(states):
            posed = pose_by_states(result, given, T_pose_root, limits=limits is not False)
    if out is not None:
        of_scan = None if colours == "part" else result.colours
        write_files(out, pose_files(posed.pose, posed.points(result), result.labels, of_scan))
    if as_json:
        print(posed.pose.model_dump_json(indent=1))
    else:
        show(posed.pose, result.model, screen())
        if out is not None:
            typer.echo(f"written: {out / 'posed.ply'}, {out / 'pose.json'}")


def show(pose: Pose, model: ModelFile, console: Console) -> None:
    """Print a line for each joint, the distances to the targets, and the undetermined joints."""
    length = LENGTH_SYMBOLS[model.units]
    table = Table("joint", "type", "state", "observed range", "")
    for joint in model.joints:
        remark = "not told by the targets" if joint.name in pose.undetermined else ""
        remark = "at its limit" if joint.name in pose.at_limit else remark
        state = " ".join(f"{value + 0.0:.4g}" for value in np.atleast_1d(pose.states[joint.name]))
        table.add_row(escape(joint.name), joint.type, state, observed_range(joint, length), remark)
    console.print(table)
    if pose.base_undetermined:
        console.print("the targets do not determine all of the base's motion")
    if pose.targets is not None:
        count, fit = len(pose.targets.residuals), pose.targets
        console.print(f"{count} targets, missed by {fit.rms:.4g} {length} RMS, {fit.greatest:.4g} {length} at most")
