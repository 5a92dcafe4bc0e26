"""Kills at random moments of a fit: the same command then makes the same model, and nothing is lost or left."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from attacks.command import alive, end_session, session
from attacks.delivered import DELIVERED, whole
from attacks.hinge import Prepared
from pipeline.store import artifacts

FIT = 'exec reart fit frames --out out --preset "$TINY" --truth frames/ground_truth.npz'
LEFTOVERS = (f"**/{artifacts.STAGING}*", f"**/{artifacts.REPLACED}*", "**/*.partial*", "**/.*.tmp*")
DELIVERY_SHARE = 0.4  # of the kills
SHARED_MEMORY = Path("/dev/shm")
POLL = 0.002

Target = Literal["all", "command line", "engine", "worker"]


@dataclass(frozen=True)
class Plan:
    """Whom to kill, and when: seconds after the start, or after the first delivered file has changed."""

    target: Target
    delivering: bool
    seconds: float
    over_another: bool  # the folder holds another model's files before


@dataclass(frozen=True)
class Kill:
    """A kill, and what did not hold."""

    plan: Plan
    killed: str
    complete: int  # artifacts at that moment
    faults: tuple[str, ...]


def plans(count: int, run_seconds: float, rng: np.random.Generator) -> list[Plan]:
    """Random moments over a run, and around its delivery, which takes a tenth of a second or so."""
    found = []
    for index in range(count):
        delivering = index < DELIVERY_SHARE * count
        targets: tuple[Target, ...] = (
            ("all", "command line") if delivering else ("all", "command line", "engine", "worker")
        )
        seconds = float(rng.uniform(0, 0.03 if delivering else run_seconds))
        found.append(Plan(targets[int(rng.integers(len(targets)))], delivering, seconds, bool(rng.integers(2))))
    return found


def undisturbed(prepared: Prepared, folder: Path) -> tuple[str, float]:
    """The model of an undisturbed fit, and how long that takes. Raises RuntimeError where it fails."""
    folder.mkdir(parents=True)
    prepared.give(folder, "frames")
    ran = prepared.run(FIT, folder)
    if ran.code != 0:
        raise RuntimeError(f"{FIT}: exit code {ran.code}\n{ran.words}")
    return fingerprint(folder / "out"), ran.seconds


def attack(
    prepared: Prepared, folder: Path, count: int, rng: np.random.Generator, report: Callable[[Kill], None]
) -> list[Kill]:
    """Kill so many fits, each in a folder of its own, and give the same command again."""
    expected, seconds = undisturbed(prepared, folder / "undisturbed")
    kills = []
    for index, plan in enumerate(plans(count, seconds, rng)):
        kills.append(kill_one(prepared, folder / f"{index:04d}", plan, expected))
        report(kills[-1])
        shutil.rmtree(folder / f"{index:04d}")
    return kills


def kill_one(prepared: Prepared, folder: Path, plan: Plan, expected: str) -> Kill:
    """One fit that is killed, and what is found afterwards."""
    folder.mkdir(parents=True)
    prepared.give(folder, "frames")
    out = folder / "out"
    if plan.delivering:  # all is computed: what is left to do is to deliver
        shutil.copytree(prepared.folder / "model" / "workdir", out / "workdir")
    if plan.over_another:
        shutil.copytree(
            prepared.folder / "lid_model", out, dirs_exist_ok=True, ignore=shutil.ignore_patterns("workdir")
        )
    shared = set(os.listdir(SHARED_MEMORY))
    with Watch(out) as watch:
        killed, code = run_and_kill(prepared, folder, plan)
        complete = completed(out)
        ran = prepared.run(FIT, folder)
    faults = [f"torn: {name}" for name in sorted(watch.torn)]
    faults += [f"outlived it: {name}" for name in killed.survivors]
    if ran.code != 0:
        faults.append(f"the same command ends with {ran.code}: {' '.join(ran.words.split())[-200:]}")
    elif fingerprint(out) != expected:
        faults.append("the model is another")
    after = completed(out)
    faults += [f"lost or computed anew: {name}" for name in sorted(complete) if complete[name] != after.get(name)]
    faults += [f"left: {path.relative_to(folder)}" for pattern in LEFTOVERS for path in sorted(out.glob(pattern))]
    faults += [f"left: /dev/shm/{name}" for name in stays(shared)]
    if plan.target == "worker" and code == 0 and killed.name == "worker":
        faults.append("a killed worker went unnoticed") if not (out / "model.json").exists() else None
    return Kill(plan, killed.name, len(complete), tuple(faults))


@dataclass(frozen=True)
class Killed:
    name: str
    survivors: tuple[str, ...]


def run_and_kill(prepared: Prepared, folder: Path, plan: Plan) -> tuple[Killed, int]:
    """Start a fit, kill as planned, and wait for the end of it all. What was killed, and the exit code."""
    before = stamps(folder / "out")
    process = subprocess.Popen(
        ["bash", "-c", FIT],
        cwd=folder,
        env=prepared.environment(folder),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    while plan.delivering and process.poll() is None and stamps(folder / "out") == before:
        time.sleep(POLL)
    time.sleep(plan.seconds)
    name = kill(process.pid, plan.target)
    try:
        code = process.wait(timeout=60)
    except subprocess.TimeoutExpired:
        end_session(process.pid)
        return Killed(name, ("the command itself, for a minute",)), process.wait()
    survivors = tuple(map(str, alive(process.pid, patience=5.0)))
    end_session(process.pid)
    return Killed(name, survivors), code


def kill(leader: int, target: Target) -> str:
    """Kill a whole session, or the one process; what there was to kill."""
    if target == "all":
        found = list(session(leader))
        for pid in found:
            _kill(pid)
        return f"all {len(found)}"
    engine = children(leader)
    workers = [pid for parent in engine for pid in children(parent)]
    chosen = {"command line": [leader], "engine": engine, "worker": workers or engine}[target][:1]
    for pid in chosen:
        _kill(pid)
    return ("engine" if target == "worker" and not workers else target) if chosen else "nobody"


def children(parent: int) -> list[int]:
    try:
        return [int(word) for word in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]
    except OSError:
        return []


def _kill(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


class Watch:
    """Reads delivered files again and again: each is whole at every moment."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.torn = folder, set[str]()
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._seen: dict[str, int] = {}

    def __enter__(self) -> Watch:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._done.set()
        self._thread.join()
        self.look()

    def _look(self) -> None:
        while not self._done.wait(0.01):
            self.look()

    def look(self) -> None:
        """Read what has changed since it was last read whole."""
        for name, stamp in stamps(self.folder).items():
            if self._seen.get(name) == stamp:
                continue
            try:
                content = (self.folder / name).read_bytes()
            except FileNotFoundError:
                continue  # removed, which is not half of it
            if whole(name, content):
                self._seen[name] = stamp
            else:
                self.torn.add(name)


def stamps(folder: Path) -> dict[str, int]:
    """When each delivered file was written, and which inode that is."""
    found = {}
    for pattern in DELIVERED:
        for path in folder.glob(pattern):
            try:
                status = path.stat()
            except FileNotFoundError:
                continue
            found[path.relative_to(folder).as_posix()] = hash((status.st_mtime_ns, status.st_ino, status.st_size))
    return found


def completed(out: Path) -> dict[str, int]:
    """The complete artifacts, and when they were."""
    return {path.parent.name: path.stat().st_mtime_ns for path in out.glob(f"workdir/*/*/*/{artifacts.MANIFEST}")}


def fingerprint(out: Path) -> str:
    """Of the model: labels, motions and joints."""
    total = hashlib.sha256()
    with np.load(out / "model.npz") as arrays:
        for name in sorted(arrays.files):
            total.update(name.encode() + arrays[name].tobytes())
    model = json.loads((out / "model.json").read_bytes())
    total.update(json.dumps([model["parts"], model["joints"]], sort_keys=True).encode())
    return total.hexdigest()


def stays(before: set[str], patience: float = 2.0) -> list[str]:
    """What is new in shared memory, and stays there."""
    deadline = time.monotonic() + patience
    while (new := set(os.listdir(SHARED_MEMORY)) - before) and time.monotonic() < deadline:
        time.sleep(0.1)
    return sorted(new)
