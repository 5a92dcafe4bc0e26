"""Where the sequences of a request stand, from what is on the disk."""

from __future__ import annotations

from typing import Literal

from pydantic import ValidationError

from pipeline import store
from pipeline.plan import plan
from pipeline.protocol import Event, Request
from pipeline.task import StageTask, upstream_first
from pipeline.tasks import final_tasks
from schemas.artifact import Schema
from schemas.manifest import Failure

State = Literal["done", "failed", "corrupt", "stale", "missing"]


class TaskStatus(Schema):
    """One task: `stale` means that only an artifact of other settings, input or code is there."""

    sequence: str
    stage: str
    task: str
    state: State
    seconds: float | None = None
    message: str | None = None
    log: str | None = None
    path: str | None = None


def collect(request: Request) -> list[TaskStatus]:
    """The state of every task of a request, sequence by sequence. Raises InputError as `plan` does."""
    unreadable: list[TaskStatus] = []

    def note(event: Event) -> None:
        state: State = "failed" if event.kind == "failed" else "missing"
        unreadable.append(
            TaskStatus(sequence=event.sequence, stage=event.task, task=event.task, state=state, message=event.message)
        )

    jobs = plan(request, note)
    return unreadable + [task_status(task) for job in jobs for task in upstream_first(final_tasks(job))]


def task_status(task: StageTask) -> TaskStatus:
    """The state of one task."""

    def status(state: State, **more: object) -> TaskStatus:
        name = {"sequence": task.job.source.name, "stage": task.stage, "task": task.label}
        return TaskStatus.model_validate({**name, "state": state, "path": str(task.directory), **more})

    if task.complete():
        try:
            return status("done", seconds=sum(store.read_manifest(task.directory).seconds.values()))
        except store.CorruptArtifactError as error:
            return status("corrupt", message=str(error))
    if task.failure_path.exists():
        return status("failed", message=_failure_message(task), log=str(task.log_path))
    others = task.job.folder.glob(f"{task.stage}-*/{store.MANIFEST}")
    return status("stale" if any(others) else "missing")


def _failure_message(task: StageTask) -> str:
    try:
        return Failure.model_validate_json(task.failure_path.read_bytes()).message
    except (OSError, ValidationError) as error:
        return f"{task.failure_path.name} cannot be read ({type(error).__name__})"
