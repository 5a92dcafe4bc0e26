"""The place of one task's artifact, and of the files beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Place:
    """The place of one task's artifact, `<stage>-<key>/` in its sequence's folder. It need not exist yet."""

    sequence: str
    task: str  # the stage's label, as in `merging[0]`
    directory: Path

    @property
    def stage(self) -> str:
        return stage_of(self.task)

    @property
    def log(self) -> Path:
        return self.directory.with_name(f"{self.directory.name}.log")

    @property
    def failure(self) -> Path:
        return self.directory.with_name(f"{self.directory.name}.failed.json")


def stage_of(task: str) -> str:
    """The stage in a task's label: `relaxed_fit` for `relaxed_fit[1]`."""
    return task.partition("[")[0]
