"""`reart rerun`: compute a stage and all later ones anew."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import (
    DataOption,
    DatasetOption,
    JointsOption,
    PresetOption,
    SeedOption,
    SetOption,
    WorkdirOption,
    WorkersOption,
    dataset_config,
    writable_folder,
)
from pipeline.cli.run import finish
from pipeline.run.protocol import Request


def rerun(
    stage: Annotated[str, typer.Argument(help="The first stage to compute anew, as in `reart status`.")],
    *,
    dataset: DatasetOption,
    sequence: Annotated[str, typer.Option(help="The sequence.")],
    data: DataOption = None,
    workdir: WorkdirOption = Path("workdir"),
    preset: PresetOption = None,
    seed: SeedOption = None,
    joints: JointsOption = None,
    workers: WorkersOption,
    settings: SetOption,
) -> None:
    """Compute a stage of one sequence, and all later ones, anew.

    Each old artifact stays until the new one replaces it, so nothing is lost if this fails or is killed.

    Example: `reart rerun final_fit --dataset roboart --sequence bolt`
    """
    request = Request(
        dataset=dataset,
        workdir=writable_folder(workdir, "--workdir"),
        config=dataset_config(dataset, preset, settings, seed, joints),
        data=data,
        sequences=(sequence,),
        workers=workers,
        rerun=stage,
    )
    finish(request)
