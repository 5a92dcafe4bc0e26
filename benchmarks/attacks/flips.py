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

from attacks.case import outcome
from attacks.delivered import DELIVERED, delivered_problem
from attacks.hinge import Prepared
from pipeline import store

How = Literal["flipped", "cut", "removed"]
Found = Literal["found", "same", "missed", "escaped"]  # `same`: what is read is what was written
SHARES = {"flipped": 0.9, "cut": 0.05, "removed": 0.05}
COMMANDS = {
    "status": 'reart status --dataset scans --data data --preset "$TINY" --workdir workdir --check',
    "evaluate": 'reart evaluate --dataset scans --data data --preset "$TINY" --workdir workdir',
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


def flip_artifacts(folder: Path, count: int, rng: np.random.Generator, report: Callable[[Flip], None]) -> list[Flip]:
    """Damage random files of all artifacts below `folder`, each file as often as another, and read the artifact."""
    files = sorted(
        path for manifest in folder.rglob(store.MANIFEST) for path in manifest.parent.rglob("*") if path.is_file()
    )
    flips = []
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
    return store.read_manifest(directory), store.read_files(directory)


def judge_read(read: Callable[[], object], before: object) -> tuple[Found, str]:
    """What became of a read of something damaged."""
    try:
        after = read()
    except store.CorruptArtifactError as error:
        return "found", str(error)
    except Exception as error:  # whatever else escapes from the reader is what is looked for
        return "escaped", f"{type(error).__name__}: {error}"
    return ("same" if after == before else "missed"), ""


def flip_delivered(
    folder: Path, count: int, rng: np.random.Generator, report: Callable[[Flip], None], every: bool = True
) -> list[Flip]:
    """Damage every file that a fit delivered `count` times, and look at what checks that folder."""
    flips = []
    names = [path for pattern in DELIVERED for path in sorted(folder.glob(pattern))]
    for path in names:
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
        own = folder / f"{index:04d}"
        own.mkdir(parents=True)
        prepared.give(own, "data", "workdir")
        scans = own / "workdir" / "scans"
        manifests = sorted(scans.glob(f"*/*/{store.MANIFEST}"))
        files = sorted(path for manifest in manifests for path in manifest.parent.rglob("*") if path.is_file())
        path = files[int(rng.integers(len(files)))]
        offset, content = damage(path.read_bytes(), how, rng)
        path.unlink() if content is None else path.write_bytes(content)
        command = list(COMMANDS)[index % len(COMMANDS)]
        found, said = judge_command(command, prepared, own)
        flips.append(Flip(f"{command}: {path.relative_to(scans).as_posix()}", how, offset, found, said))
        report(flips[-1])
        shutil.rmtree(own)
    return flips


def judge_command(command: str, prepared: Prepared, folder: Path) -> tuple[Found, str]:
    """Whether a command says so, makes anew what was damaged, or shows the same since it does not read that."""
    evaluation = folder / "workdir" / "scans" / "evaluation" / "evaluation.json"
    before = _figures(evaluation)
    ran = prepared.run(COMMANDS[command], folder)
    verdict, wrong = outcome(ran)
    if ran.traceback or (wrong and verdict == "broken" and ran.code not in (1, 2)):
        return "escaped", "; ".join(wrong) or ran.err[-300:]
    if ran.code != 0:
        return "found", " ".join(ran.words.split())[-300:]
    if command == "status":
        return ("missed" if unsound(folder) else "same"), ""
    return ("same" if _figures(evaluation) == before else "missed"), "" if not unsound(folder) else "not read"


def unsound(folder: Path) -> list[str]:
    """What of the artifacts is not as it was written."""
    problems = []
    for manifest in folder.glob(f"workdir/*/*/*/{store.MANIFEST}"):
        try:
            _read(manifest.parent)
        except store.CorruptArtifactError as error:
            problems.append(str(error))
    return problems


def _figures(evaluation: Path) -> object:
    """What an evaluation says of the models; the times aside."""
    return [
        (score["sequence"], score["metrics"], score["result"])
        for score in json.loads(evaluation.read_bytes())["sequences"]
    ]
