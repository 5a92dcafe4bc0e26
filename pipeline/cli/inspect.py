"""`reart inspect`: the content of an artifact, and whether it is intact."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console
from rich.table import Table

from pipeline.cli.options import JsonOption, screen
from pipeline.results import inspection
from pipeline.results.delivery import RECORD, check_delivery
from pipeline.store.artifacts import MANIFEST
from schemas.errors import InputError


def inspect(
    path: Annotated[
        Path,
        typer.Argument(
            help="An artifact's folder, as in workdir/roboart/bolt/flow-0123456789abcdef, or one that `fit` filled."
        ),
    ],
    as_json: JsonOption = False,
) -> None:
    """Show an artifact: its provenance, arrays and energies. The exit code is 1 if it is corrupt.

    For a folder that `reart fit` or `reart export` wrote, check that every file is unchanged.

    Examples:

    - `reart inspect workdir/roboart/bolt/final_fit-0123456789abcdef --json`

    - `reart inspect models/lamp`
    """
    if (path / RECORD).is_file() and not (path / MANIFEST).is_file():
        show_delivery(check_delivery(path), as_json)
    if not (path / MANIFEST).is_file():
        raise InputError(
            f"{path}: found no {MANIFEST}, expected the folder of a complete artifact, "
            "as in workdir/roboart/bolt/flow-0123456789abcdef; check the path"
        )
    report = inspection.inspect(path)
    if as_json:
        print(report.model_dump_json(indent=1))
    else:
        show(report, screen())
    raise typer.Exit(1 if report.problems else 0)


def show_delivery(problems: list[str], as_json: bool) -> NoReturn:
    """Print the problems of delivered files, and exit."""
    if as_json:
        print(json.dumps({"problems": problems}, indent=1))
    else:
        print("\n".join(f"changed: {problem}" for problem in problems) or "every file is as it was written")
    raise typer.Exit(1 if problems else 0)


def show(report: inspection.Inspection, console: Console) -> None:
    """Print the manifest without the configuration, the arrays, the energies and the problems."""
    if report.manifest is not None:
        manifest = report.manifest.model_dump(mode="json", exclude={"config", "arrays", "payload", "files", "digest"})
        for name, value in manifest.items():
            console.print(f"{name:>15}  {_text(value)}", soft_wrap=True, markup=False)
        table = Table("array", "dtype", "shape", "unit", "least", "greatest", "NaN")
        for array in report.arrays:
            entry = array.entry
            axes = zip(entry.shape, entry.dims, strict=True)
            shape = " x ".join(dim if dim.isdigit() else f"{size} {dim}" for size, dim in axes)
            values = (array.minimum, array.maximum, array.nan_count)
            table.add_row(
                entry.name, entry.dtype, shape, entry.unit, *("-" if v is None else f"{v:.6g}" for v in values)
            )
        console.print(table)
    for name, energy in report.energies.items():
        console.print(f"{name:>15}  {energy:.6g}", markup=False)
    for problem in report.problems:
        console.print(f"corrupt: {problem}", soft_wrap=True, markup=False)


def _text(value: object) -> str:
    if isinstance(value, dict):
        return "  ".join(f"{name} {item}" for name, item in value.items()) or "-"
    return str(value)
