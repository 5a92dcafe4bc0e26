"""A hostile input, and the verdict on what came of it."""

from __future__ import annotations

import hashlib
import os
import re
import stat
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from attacks.command import GIB, SECONDS, Ran
from attacks.hinge import Prepared

Verdict = Literal["refused", "accepted", "failed", "ended", "broken", "skipped"]
Maker = Callable[[Path, Prepared], None]
Check = Callable[[Path, Ran], str]  # what is wrong with what came of it; empty where nothing is

WRITABLE = (
    "out",
    "workdir",
    "tmp",
    "model/workdir",
)  # what a command may change in its folder, unless a case says more


def nothing(folder: Path, prepared: Prepared) -> None:
    """No files."""


@dataclass(frozen=True)
class Case:
    """Files in a fresh folder, a line of bash that is run there, and what may come of it.

    `refused` is exit code 2 and one line of error, `accepted` exit code 0, `failed` exit code 1 with a cause that is
    shown. `says` must be found in what is said. `keeps` are paths that stay as they are though their folder is written.
    """

    name: str
    command: str
    make: Maker = nothing
    may: tuple[Verdict, ...] = ("refused", "accepted")
    says: str = ""
    check: Check | None = None
    keeps: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()
    exits: tuple[int, ...] = ()  # further exit codes that are right, as that of a signal: then it is `ended`
    similar: bool = False  # no report named it: thought out here, alike
    terminal: bool = False
    needs_root: bool = False
    seconds: float = SECONDS
    gib: float = GIB


@dataclass(frozen=True)
class Judged:
    """The verdict on a case, and why it is broken."""

    case: Case
    verdict: Verdict
    reasons: tuple[str, ...] = ()
    ran: Ran | None = None


def similar(*cases: Case) -> list[Case]:
    """The same, marked as thought out here."""
    return [replace(case, similar=True) for case in cases]


def outcome(ran: Ran) -> tuple[Verdict, list[str]]:
    """What an ended command did, and what is wrong with how it did it."""
    wrong = []
    if ran.code is None:
        return "broken", [f"ended after {ran.seconds:.0f} s with {ran.peak_gib:.1f} GiB"]
    if ran.traceback:
        wrong.append("traceback")
    if ran.left:
        wrong.append(f"left running: {', '.join(ran.left)}")
    errors = [line for line in ran.err.splitlines() if re.match(r"error: .", line)]
    if ran.code == 0:
        return ("broken" if wrong else "accepted"), wrong
    if ran.code == 2:
        if len(errors) != 1:
            wrong.append(f"{len(errors)} lines of error")
        return ("broken" if wrong else "refused"), wrong
    if ran.code == 1:
        if not ran.words.strip():
            wrong.append("no word of why")
        return ("broken" if wrong else "failed"), wrong
    return "broken", [*wrong, f"exit code {ran.code}"]


def judge(case: Case, folder: Path, prepared: Prepared) -> Judged:
    """Make a case's files in a fresh folder, run it, and look at what came of it."""
    if case.needs_root and os.geteuid() != 0:
        return Judged(case, "skipped", ("needs root",))
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    case.make(folder, prepared)
    env = prepared.environment(folder)
    before = contents(folder, case)
    ran = prepared.run(case.command, folder, seconds=case.seconds, gib=case.gib, on_terminal=case.terminal)
    verdict, reasons = outcome(ran)
    if ran.code in case.exits and ran.code is not None:  # nobody may be there to whom anything could be said
        reasons = [reason for reason in reasons if reason.startswith(("traceback", "left running"))]
        verdict = "broken" if reasons else "ended"
    elif verdict not in (*case.may, "broken"):
        reasons.append(f"{verdict}, expected {' or '.join(case.may)}")
    if ran.peak_gib > case.gib:
        reasons.append(f"{ran.peak_gib:.1f} GiB")
    if case.says and not re.search(case.says, " ".join(ran.words.split()), re.IGNORECASE):
        reasons.append(f"does not say {case.says!r}")
    reasons += [f"changed {name}" for name in changed(before, contents(folder, case))]
    reasons += [f"left {path.name} among the temporary files" for path in sorted(Path(env["TMPDIR"]).iterdir())]
    if case.check is not None and verdict in ("accepted", "failed", "ended") and (complaint := case.check(folder, ran)):
        reasons.append(complaint)
    return Judged(case, "broken" if reasons else verdict, tuple(reasons), ran)


def contents(folder: Path, case: Case) -> dict[str, str]:
    """Everything in a folder that a command must leave alone, by path: what it is, or holds."""
    found = {}
    for root, folders, files in os.walk(folder):
        relative = Path(root).relative_to(folder)
        for name in [*folders, *files]:
            path = (relative / name).as_posix()
            if not _is_in(path, (*WRITABLE, *case.writes)) or _is_in(path, case.keeps):
                found[path] = _holds(folder / path)
    return found


def changed(before: dict[str, str], after: dict[str, str]) -> list[str]:
    return sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))


def _is_in(path: str, places: tuple[str, ...]) -> bool:
    return any(path == place or path.startswith(f"{place}/") for place in places)


def _holds(path: Path) -> str:
    status = path.lstat()
    if stat.S_ISLNK(status.st_mode):
        return f"link to {os.readlink(path)}"
    if not stat.S_ISREG(status.st_mode):
        return f"kind {stat.S_IFMT(status.st_mode)}"
    if status.st_size > 2**26:
        return f"{status.st_size} bytes of {status.st_mtime_ns}"
    return hashlib.sha256(path.read_bytes()).hexdigest()
