"""The state of every task of a request, read from the disk."""

from __future__ import annotations

import os
from typing import Literal

from pydantic import ValidationError

from pipeline.run.place import Place
from pipeline.run.plan import plan
from pipeline.run.protocol import Event, Request
from pipeline.run.task import upstream_first
from pipeline.run.tasks import final_tasks
from pipeline.store import artifacts
from schemas.artifact import Schema
from schemas.manifest import Failure

State = Literal["done", "failed", "corrupt", "unreadable", "stale", "missing"]


class TaskStatus(Schema):
    """The state of one task.

    `stale` means that only artifacts of other settings, input or code exist. `unreadable` means that this process lacks
    the memory or the permission to check.
    """

    sequence: str
    stage: str
    task: str
    state: State
    seconds: float | None = None
    message: str | None = None
    log: str | None = None
    path: str | None = None


def collect(request: Request, check: bool = False) -> list[TaskStatus]:
    """The state of every task of a request, by sequence. `check` reads every file. Raises InputError as `plan` does."""
    unreadable: list[TaskStatus] = []

    def note(event: Event) -> None:
        state: State = "failed" if event.kind == "failed" else "missing"
        unreadable.append(
            TaskStatus(sequence=event.sequence, stage=event.task, task=event.task, state=state, message=event.message)
        )

    jobs = plan(request, note)
    tasks = [task for job in jobs for task in upstream_first(final_tasks(job))]
    return unreadable + [task_status(task.place, check) for task in tasks]


def task_status(place: Place, check: bool = False) -> TaskStatus:
    """The state of one task. An artifact with a manifest counts as done; `check` also reads all its files."""

    def status(state: State, **more: object) -> TaskStatus:
        name = {"sequence": place.sequence, "stage": place.stage, "task": place.task}
        return TaskStatus.model_validate({**name, "state": state, "path": str(place.directory), **more})

    try:
        if artifacts.completed_at(place.directory) is not None:
            if check:
                artifacts.read_files(place.directory)
            return status("done", seconds=sum(artifacts.read_manifest(place.directory).seconds.values()))
    except artifacts.CorruptArtifactError as error:
        return status("corrupt", message=str(error))
    except artifacts.UnreadableArtifactError as error:
        return status("unreadable", message=str(error))
    if os.path.lexists(place.failure):
        return status("failed", message=_failure_message(place), log=str(place.log))
    others = place.directory.parent.glob(f"{place.stage}-*/{artifacts.MANIFEST}")
    return status("stale" if any(others) else "missing")


def _failure_message(place: Place) -> str:
    try:
        return Failure.model_validate_json(place.failure.read_bytes()).message
    except (OSError, ValidationError) as error:
        return f"{place.failure.name} cannot be read ({type(error).__name__})"
