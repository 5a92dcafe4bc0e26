"""Two boxes with a hinge between them: the sequence that all is done to, and what is computed of it once."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from attacks.command import Ran, environment, install, run

PRESET = Path(__file__).with_name("tiny.toml")
FRAMES, POINTS, STEP = 6, 400, 0.3  # of the sequence; radians from frame to frame


def hinge(seed: int = 0, frames: int = FRAMES, points: int = POINTS, step: float = STEP) -> list[np.ndarray]:
    """The points of each frame, (points, 3), sampled anew; the first half belongs to the box that stands still."""
    rng = np.random.default_rng(seed)
    return [_boxes(rng, points // 2, step * t) for t in range(frames)]


def _boxes(rng: np.random.Generator, points: int, angle: float) -> np.ndarray:
    halves = []
    for part in range(2):
        p = rng.uniform(size=(points, 3))
        p[np.arange(points), rng.integers(3, size=points)] = rng.integers(2, size=points)
        halves.append(p * [1.0, 0.3, 0.2] - [1.05 if part == 0 else -0.05, 0, 0])
    halves[1] = halves[1] @ turn(angle)[:3, :3].T
    return np.concatenate(halves)


def turn(angle: float) -> np.ndarray:
    """About the z axis, (4, 4)."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return T


def write_sequence(folder: Path, seed: int = 0) -> None:
    """Frames as .npy, and the ground truth beside them."""
    folder.mkdir(parents=True)
    for t, points in enumerate(hinge(seed)):
        np.save(folder / f"frame_{t}.npy", points)
    Ts = np.tile(np.eye(4), (FRAMES, 2, 1, 1))
    Ts[:, 1] = [turn(STEP * t) for t in range(FRAMES)]
    labels = np.tile(np.repeat([0, 1], POINTS // 2), (FRAMES, 1))
    np.savez(folder / "ground_truth.npz", labels=labels, poses=Ts, novel_poses=Ts[1:2])


@dataclass(frozen=True)
class Prepared:
    """A folder: `frames` and their `model`, another sequence `lid` and `lid_model`; a data set `data` and `workdir`."""

    folder: Path

    @property
    def bin(self) -> Path:
        return self.folder / "bin"

    def environment(self, folder: Path) -> dict[str, str]:
        return environment(folder, self.bin, PRESET)

    def run(self, line: str, folder: Path, **limits: object) -> Ran:
        return run(line, folder, self.environment(folder), **limits)  # type: ignore[arg-type]

    def give(self, folder: Path, *names: str) -> None:
        """Copies of what is prepared."""
        for name in names:
            if not (folder / name).exists():
                shutil.copytree(self.folder / name, folder / name, symlinks=True)


def prepare(folder: Path) -> Prepared:
    """Make the sequences and compute what is needed of them. Raises RuntimeError where that fails."""
    prepared = Prepared(folder)
    install(prepared.bin)
    write_sequence(folder / "frames")
    write_sequence(folder / "data" / "box")
    write_sequence(folder / "data" / "lid", seed=1)
    write_sequence(folder / "lid", seed=1)
    for line in (
        'reart fit frames --out model --preset "$TINY" --truth frames/ground_truth.npz',
        'reart fit lid --out lid_model --preset "$TINY" --truth lid/ground_truth.npz',
        'reart run --dataset scans --data data --preset "$TINY" --workdir workdir',
    ):
        ran = prepared.run(line, folder)
        if ran.code != 0:
            raise RuntimeError(f"{line}: exit code {ran.code}\n{ran.words}")
    return prepared
