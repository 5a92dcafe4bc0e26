"""`reart inspect`: what an artifact holds, and whether it is sound."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from pipeline import inspection
from pipeline.cli.options import JsonOption, screen
from pipeline.store import MANIFEST
from schemas.errors import InputError


def inspect(
    path: Annotated[
        Path, typer.Argument(help="An artifact's folder, as in workdir/roboart/bolt/flow-0123456789abcdef.")
    ],
    as_json: JsonOption = False,
) -> None:
    """Show an artifact: where it came from, its arrays and energies. Exit code 1 where it is corrupt.

    Example: `reart inspect workdir/roboart/bolt/final_fit-0123456789abcdef --json`
    """
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


def show(report: inspection.Inspection, console: Console) -> None:
    """The manifest but for the configuration, the arrays, the energies, and what is corrupt."""
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
