"""`reart train-flow`: train the feature network of the flow stage."""

from __future__ import annotations

import sys
from collections import deque
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from pipeline.cli.options import SetOption, screen, writable_folder
from pipeline.configuration.presets import TRAINING_FOLDER, load_settings
from schemas.config import TrainFlowConfig
from schemas.training import Measurement, Step

RECENT = 20  # the loss that is shown is the mean over so many steps


def train_flow(
    out: Annotated[
        Path, typer.Option(help="Where checkpoint, log, curve and weights go; what is there is gone on with.")
    ],
    *,
    config: Annotated[
        Path | None,
        typer.Option(
            help="A .toml file of settings; `reart train-flow` without it trains as the shipped weights were."
        ),
    ] = None,
    preset: Annotated[str | None, typer.Option(help="Settings that come with the program: `smoke`, a minute.")] = None,
    settings: SetOption,
    assets: Annotated[
        Path | None, typer.Option(help="A folder of robot descriptions, NAME/NAME.urdf; without it, those of packages.")
    ] = None,
) -> None:
    """Train the network that the flow estimators `network` and `hybrid` match points with.

    The same command resumes an interrupted training. Use the result by
    `--set flow.network.weights=OUT/weights.safetensors`.

    - `reart train-flow --out training --assets robots`

    - `reart train-flow --out training --set steps=20000 --set points=4096`
    """
    presets = [name for name in (preset, str(config) if config else None) if name is not None]
    chosen = load_settings(TrainFlowConfig, TRAINING_FOLDER, presets, settings)
    folder = writable_folder(out, "--out")
    from pipeline.training.batches import MakerDied
    from pipeline.training.folder import train  # torch takes seconds to import

    console = screen()
    losses: deque[float] = deque(maxlen=RECENT)
    with Progress(
        TextColumn("step {task.completed}/{task.total}"),
        BarColumn(),
        TimeRemainingColumn(),
        TextColumn("loss {task.fields[loss]:.3f}"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task("", total=chosen.steps, loss=float("nan"))

        def report(line: Step | Measurement) -> None:
            if isinstance(line, Step):
                losses.append(line.loss)
                bar.update(task, completed=line.step, loss=float(np.mean(losses)))
            else:
                console.print(
                    f"step {line.step}: loss {np.mean(losses):.3f}, on validation {line.loss:.3f}; right "
                    f"{line.right:.0%} of points, {line.mutual_right:.0%} of the {line.mutual:.0%} matched"
                )

        try:
            weights = train(chosen, folder, assets, report)
        except MakerDied as error:
            print(
                f"error: the process that makes pairs to train on ended ({error}); "
                f"what {folder} holds is kept: give the same command again",
                file=sys.stderr,
            )
            raise typer.Exit(1) from error
    typer.echo(f"written: {weights}")
