"""`reart figure`: a picture of a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import ModelArgument, writable_folder
from pipeline.results.model_folder import ingested_of_model, read_model_folder
from pipeline.store.files import write_atomically
from schemas.errors import InputError

FORMATS = (".png", ".svg", ".pdf")


def figure(
    model: ModelArgument,
    *,
    out: Annotated[Path, typer.Option(help="The picture: .png, .svg or .pdf.")],
) -> None:
    """Draw a model: the input, its parts and screw axes, the kinematic tree, the implied flow, and a posed frame.

    A second row shows the ground truth if the fit's artifacts still exist and hold it.

    Example: `reart figure models/lamp --out lamp.png`
    """
    if out.suffix.lower() not in FORMATS:
        raise InputError(f"--out {out}: found {out.suffix or 'no ending'}, expected {', '.join(FORMATS)}; rename it")
    if out.is_dir():
        raise InputError(f"--out {out}: found a folder, expected a picture; give another path")
    result = read_model_folder(model)
    writable_folder(out.parent, "--out")
    from stages.report.figure import draw  # matplotlib takes a second to import
    from stages.support.pictures import picture_bytes

    picture = draw(result, ingested_of_model(model, result))
    write_atomically(out, picture_bytes(picture, out.suffix.lower().removeprefix("."), dpi=110))
    typer.echo(f"written: {out}")
