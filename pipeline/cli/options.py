"""Options that several commands share, and how they show and end a run."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from pipeline.cli.display import RunDisplay
from pipeline.configuration.presets import DATASETS, dataset_presets, load_config
from pipeline.run import launch
from pipeline.run.failures import AGAIN
from pipeline.run.protocol import Request
from pipeline.store import artifacts
from schemas.config import PipelineConfig
from schemas.errors import InputError
from schemas.joints import JOINT_KINDS


def cores() -> int:
    """The number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


DatasetOption = Annotated[str, typer.Option(help=f"The data set: {', '.join(DATASETS)}.")]
WorkdirOption = Annotated[Path, typer.Option(help="Where artifacts are kept.")]
DataOption = Annotated[
    Path | None,
    typer.Option(
        "--data",
        "--assets",
        help="The folder of sequences, where the data set is files; for roboart and urdf that of robot descriptions.",
    ),
]
SequencesOption = Annotated[str | None, typer.Option(help="Only these, as in `bolt,ur5`; default: all.")]
PresetOption = Annotated[str | None, typer.Option(help="Further settings: `paper`, or the path of a .toml file.")]
SetOption = Annotated[
    list[str],
    typer.Option(
        "--set",
        default_factory=list,
        show_default=False,
        metavar="STAGE.FIELD=VALUE",
        help="Override one setting; may be repeated.",
    ),
]
SeedOption = Annotated[int | None, typer.Option(min=0, help="The same seed and input give the same model; default 0.")]
JointsOption = Annotated[
    str | None,
    typer.Option(
        help=f"The kinds of joints that a model may have, of {', '.join(JOINT_KINDS)}; "
        "spherical ones suit people, animals and ball-jointed things.",
        show_default="revolute,prismatic",
    ),
]
WorkersOption = Annotated[
    int, typer.Option(default_factory=cores, min=1, help="Stages computed at a time.", show_default="the cores")
]
ModelArgument = Annotated[
    Path,
    typer.Argument(
        help="A folder with model.json and model.npz, as `reart fit` writes it, or that model.json.",
        callback=lambda path: path.parent if path.name == "model.json" else path,
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def screen() -> Console:
    """A console on standard output. If that is no terminal, it is wide enough for any table."""
    return Console(highlight=False, width=None if sys.stdout.isatty() else 160)


def dataset_config(
    dataset: str,
    preset: str | None,
    settings: list[str],
    seed: int | None,
    joints: str | None,
    options: Mapping[str, tuple[str, Any]] | None = None,
) -> PipelineConfig:
    """Load the configuration for a data set. Further `options` are as in `load_config`. Raises InputError."""
    presets = [*dataset_presets(dataset), *([] if preset is None else [preset])]
    shared = {"--seed": ("seed", seed), "--joints": ("projection.joints", names(joints))}
    return load_config(presets, settings, shared | dict(options or {}))


def names(listed: str | None) -> tuple[str, ...] | None:
    """Split `a,b` into names; None stays None."""
    return None if listed is None else tuple(name.strip() for name in listed.split(",") if name.strip())


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Prefix errors about a file's content with the file's name."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def writable_folder(folder: Path, option: str) -> Path:
    """Make the folder if it is missing. Raises InputError for an artifact, and if the folder is not writable."""
    if (folder / artifacts.MANIFEST).exists() and (folder / artifacts.ARRAYS).exists():
        raise InputError(f"{option} {folder}: found an artifact, whose files stay as they are; name another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except FileExistsError as error:
        raise InputError(f"{option} {folder}: found a file, expected a folder; give another path") from error
    except OSError as error:
        raise InputError(
            f"{option} {folder}: nothing can be written there ({error.strerror}); give another path"
        ) from error


def follow(request: Request, console: Console) -> launch.Outcome:
    """Run the engine and show its events. Raises InputError if it refuses the request."""
    with RunDisplay(console, request.workers) as display:
        outcome = launch.run(request, display)
    if outcome.refused:
        raise InputError(outcome.refused)
    return outcome


def name_failures(outcome: launch.Outcome) -> None:
    """Name the failed tasks on standard error, with their logs."""
    for failure in outcome.failures.values():
        log = outcome.log_of(failure)
        where = f" (log: {log})" if log and os.path.isfile(log) else ""  # False too if we may not look into its folder
        print(f"error: {failure.sequence} {failure.task}: {failure.message}{where}", file=sys.stderr)
    if outcome.died:
        again = "" if AGAIN in outcome.died else f"; see to that, {AGAIN}"
        print(f"error: {outcome.died}{again}", file=sys.stderr)
    elif not outcome.failures and not outcome.planned:
        print(
            "error: none of the sequences is available on this machine; the warnings say how to get them",
            file=sys.stderr,
        )
    elif not outcome.failures and outcome.incomplete():
        print(f"error: {len(outcome.incomplete())} artifacts are missing; give the same command again", file=sys.stderr)
