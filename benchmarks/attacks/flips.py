"""Bytes flipped in what is stored: whoever reads it must notice, or read the same as before."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from attacks.delivered import DELIVERED, delivered_problem
from attacks.hinge import Prepared
from pipeline.store import artifacts

How = Literal["flipped", "cut", "removed"]
Found = Literal["found", "same", "missed", "escaped"]  # `same`: what is read is what was written
SHARES = {"flipped": 0.9, "cut": 0.05, "removed": 0.05}
COMMANDS = {
    "status": 'reart status --dataset scans --data data --preset "$TINY" --workdir workdir --check',
    "evaluate": 'reart evaluate --dataset scans --data data --preset "$TINY" --workdir workdir',
    "inspect": "reart inspect model",
    "run": 'reart run --dataset scans --data data --preset "$TINY" --workdir workdir',
}


@dataclass(frozen=True)
class Flip:
    """What was done to a file, and what its reader made of it."""

    file: str
    how: How
    offset: int
    found: Found
    said: str


def damage(content: bytes, how: How, rng: np.random.Generator) -> tuple[int, bytes | None]:
    """Where, and what is left; None where the file is removed."""
    offset = int(rng.integers(len(content))) if content else 0
    if how == "removed" or not content:
        return 0, None
    if how == "cut":
        return offset, content[:offset]
    flipped = bytearray(content)
    flipped[offset] ^= int(rng.integers(1, 256))
    return offset, bytes(flipped)


@contextmanager
def damaged(path: Path, how: How, rng: np.random.Generator) -> Iterator[int]:
    """A file in that state, and whole again afterwards."""
    before = path.read_bytes()
    offset, after = damage(before, how, rng)
    path.unlink()
    if after is not None:
        path.write_bytes(after)
    try:
        yield offset
    finally:
        path.write_bytes(before)


def kinds(count: int, rng: np.random.Generator) -> Iterable[How]:
    return rng.choice(list(SHARES), size=count, p=list(SHARES.values()))  # type: ignore[return-value]


def stored_files(folder: Path) -> list[Path]:
    """Every file of the artifacts below a folder."""
    manifests = folder.rglob(artifacts.MANIFEST)
    return sorted(path for manifest in manifests for path in manifest.parent.rglob("*") if path.is_file())


def delivered_files(folder: Path) -> list[Path]:
    """Every file that a fit delivered."""
    return [path for pattern in DELIVERED for path in sorted(folder.glob(pattern))]


def flip_artifacts(folder: Path, count: int, rng: np.random.Generator, report: Callable[[Flip], None]) -> list[Flip]:
    """Damage random files of all artifacts below `folder`, each file as often as another, and read the artifact."""
    files, flips = stored_files(folder), []
    for how in kinds(count, rng):
        path = files[int(rng.integers(len(files)))]
        directory = next(parent for parent in path.parents if parent.parent.parent.parent == folder)
        before = _read(directory)
        with damaged(path, how, rng) as offset:
            found, said = judge_read(lambda directory=directory: _read(directory), before)  # type: ignore[misc]
        flips.append(Flip(path.relative_to(folder).as_posix(), how, offset, found, said))
        report(flips[-1])
    return flips


def _read(directory: Path) -> object:
    return artifacts.read_manifest(directory), artifacts.read_files(directory)


def judge_read(read: Callable[[], object], before: object) -> tuple[Found, str]:
    """What became of a read of something damaged."""
    try:
        after = read()
    except artifacts.CorruptArtifactError as error:
        return "found", str(error)
    except Exception as error:  # whatever else escapes from the reader is what is looked for
        return "escaped", f"{type(error).__name__}: {error}"
    return ("same" if after == before else "missed"), ""


def flip_delivered(folder: Path, count: int, rng: np.random.Generator, report: Callable[[Flip], None]) -> list[Flip]:
    """Damage every file that a fit delivered `count` times, and look at what checks that folder."""
    flips = []
    for path in delivered_files(folder):
        for how in kinds(count, rng):
            with damaged(path, how, rng) as offset:
                try:
                    problem = delivered_problem(folder)
                    found: Found = "found" if problem else "missed"
                except Exception as error:
                    found, problem = "escaped", f"{type(error).__name__}: {error}"
            flips.append(Flip(path.relative_to(folder).as_posix(), how, offset, found, problem))
            report(flips[-1])
    return flips


def flip_commands(
    prepared: Prepared, folder: Path, count: int, rng: np.random.Generator, report: Callable[[Flip], None]
) -> list[Flip]:
    """Damage a random file of a finished data set, and give the commands of a user."""
    flips = []
    for index, how in enumerate(kinds(count, rng)):
        command = list(COMMANDS)[index % len(COMMANDS)]
        own = folder / f"{index:04d}"
        own.mkdir(parents=True)
        prepared.give(own, *(("model",) if command == "inspect" else ("data", "workdir")))
        files = delivered_files(own / "model") if command == "inspect" else stored_files(own / "workdir")
        path = files[int(rng.integers(len(files)))]
        offset, content = damage(path.read_bytes(), how, rng)
        path.unlink() if content is None else path.write_bytes(content)
        found, said = judge_command(command, prepared, own)
        flips.append(Flip(f"{command}: {path.relative_to(own).as_posix()}", how, offset, found, said))
        report(flips[-1])
        shutil.rmtree(own)
    return flips


def judge_command(command: str, prepared: Prepared, folder: Path) -> tuple[Found, str]:
    """Whether a command says so, makes anew what was damaged, or shows the same since it does not read that."""
    before = _figures(folder)
    ran = prepared.run(COMMANDS[command], folder)
    if ran.traceback or ran.code not in (0, 1, 2):
        return "escaped", " ".join(ran.words.split())[-300:]
    if ran.code != 0:
        return "found", " ".join(ran.words.split())[-300:]
    if command in ("status", "inspect"):  # they are asked to look
        return "missed", ""
    return ("same" if _figures(folder) == before else "missed"), ""


def _figures(folder: Path) -> object:
    """What the evaluation of a working directory says of the models; the times aside."""
    path = folder / "workdir" / "scans" / "evaluation" / "evaluation.json"
    if not path.exists():
        return None
    scores = json.loads(path.read_bytes())["sequences"]
    return [(score["sequence"], score["metrics"], score["result"]) for score in scores]
