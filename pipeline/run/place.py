"""Where the artifact of one task lies, and what lies beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Place:
    """One task's artifact, `<stage>-<key>/` in its sequence's folder. Nothing needs to be there yet."""

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
    """The stage of a task's label: `relaxed_fit` of `relaxed_fit[1]`."""
    return task.partition("[")[0]
