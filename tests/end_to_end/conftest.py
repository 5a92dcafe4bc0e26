"""A data set of tiny hinged boxes, and the command line run on it as a user does."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import uuid
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

REART = [sys.executable, "-c", "from pipeline.cli import app; app()"]
SETTINGS = [
    "relaxed_fit.alternating.points=100",
    "relaxed_fit.alternating.rounds=2",
    "relaxed_fit.alternating.closing_rounds=1",
    "relaxed_fit.bodies.few_frames=0",
    "canonical_frame.candidates=1",
    "final_fit.iterations=4",
    "final_fit.points=100",
    "flow.geometric.nodes=12",
    "evaluation.reanimation_iterations=3",
]
TINY = [word for setting in SETTINGS for word in ("--set", setting)]


def hinged_boxes(folder: Path, seed: int, frames: int = 3, points: int = 200) -> None:
    """A box, and a second one that turns about an edge of the first; with ground truth."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True)
    Ts = np.tile(np.eye(4), (frames, 2, 1, 1))
    for t in range(frames):
        cosine, sine = np.cos(0.4 * t), np.sin(0.4 * t)
        Ts[t, 1, :2, :2] = [[cosine, -sine], [sine, cosine]]
        halves = []
        for part in range(2):
            p = rng.uniform(size=(points // 2, 3))
            p[np.arange(points // 2), rng.integers(3, size=points // 2)] = rng.integers(2, size=points // 2)
            p = p * [1.0, 0.3, 0.2] - [1.05 if part == 0 else -0.05, 0, 0]
            halves.append(p @ Ts[t, part, :3, :3].T)
        np.save(folder / f"frame_{t}.npy", np.concatenate(halves))
    labels = np.tile(np.repeat([0, 1], points // 2), (frames, 1))
    np.savez(folder / "ground_truth.npz", labels=labels, poses=Ts, novel_poses=Ts[1:2])


@dataclass
class Started:
    """A command that runs, with every process that came of it."""

    process: subprocess.Popen[str]
    mark: str
    lines: list[str] = field(default_factory=list)

    def wait_for(self, text: str) -> None:
        for line in self.process.stdout:
            self.lines.append(line)
            if text in line:
                return
        raise AssertionError(f"{text!r} never came: {self.lines} {self.process.stderr.read()}")

    def processes(self) -> list[int]:
        """Living processes, found by a mark in their environment."""
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                marked = self.mark.encode() in (entry / "environ").read_bytes()
                dead = (entry / "stat").read_text().rpartition(")")[2].split()[0] in "ZX"
            except OSError:
                continue
            if marked and not dead:
                found.append(int(entry.name))
        return found

    def end(self, signal: int) -> int:
        """Send a signal to the command alone, and wait until all that came of it is gone. The exit code."""
        self.process.send_signal(signal)
        self.process.communicate(timeout=30)
        deadline = time.monotonic() + 10
        while self.processes():
            assert time.monotonic() < deadline, "processes outlived their command"
            time.sleep(0.02)
        return self.process.returncode


@dataclass(frozen=True)
class Place:
    """A folder with a data set in `data`, from which commands are run."""

    folder: Path
    workdir_name: str = "workdir"

    @property
    def workdir(self) -> Path:
        return self.folder / self.workdir_name

    def reart(self, *words: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*REART, *map(str, words), *TINY * (words[0] not in ("inspect", "pose"))],
            cwd=self.folder,
            capture_output=True,
            text=True,
            timeout=120,
        )

    def start(self, *words: object) -> Started:
        mark = uuid.uuid4().hex
        process = subprocess.Popen(
            [*REART, *map(str, words), *TINY],
            cwd=self.folder,
            env=os.environ | {"REART_TEST_MARK": mark, "PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # a test run in the background of a shell inherits that Ctrl-C is ignored
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        return Started(process, mark)

    def manifests(self) -> dict[str, dict[str, Any]]:
        """Manifests of complete artifacts, by `sequence/stage-key`."""
        return {
            f"{path.parts[-3]}/{path.parts[-2]}": json.loads(path.read_text())
            for path in self.workdir.glob("scans/*/*/manifest.json")
        }

    def contents(self) -> dict[str, Any]:
        """What the artifacts hold, but for times and versions."""
        return {
            name: (
                {entry["name"]: entry["digest"] for entry in manifest["arrays"]},
                manifest["payload"],
                {file: digest for file, digest in manifest["files"].items() if file.startswith("model.")},
            )
            for name, manifest in self.manifests().items()
        }

    def times(self) -> dict[str, int]:
        """When each artifact was completed."""
        return {name: (self.workdir / "scans" / name / "manifest.json").stat().st_mtime_ns for name in self.manifests()}

    def hidden(self) -> list[Path]:
        """Leftovers: staging directories and the like."""
        return list(self.workdir.glob("**/.[a-z]*"))


@dataclass(frozen=True)
class Finished(Place):
    """A run of a whole data set: `box` is sound, `flat` is not."""

    outcome: subprocess.CompletedProcess[str] | None = None


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """Not to be changed."""
    folder = tmp_path_factory.mktemp("finished")
    for seed, name in enumerate(("box", "flat")):
        hinged_boxes(folder / "data" / name, seed)
    np.save(folder / "data" / "flat" / "frame_1.npy", np.zeros((200, 2)))
    return Finished(folder, outcome=Place(folder).reart("run", "--dataset", "scans", "--data", "data"))


@pytest.fixture
def fresh(finished: Finished, tmp_path: Path) -> Place:
    """The same data, and nothing computed."""
    shutil.copytree(finished.folder / "data", tmp_path / "data")
    return Place(tmp_path)


@pytest.fixture
def copy(finished: Finished, tmp_path: Path) -> Place:
    """The finished run's data and artifacts, to be changed."""
    shutil.copytree(finished.folder, tmp_path, dirs_exist_ok=True)
    return Place(tmp_path)
