"""Planning of a run: from a request to one job for each sequence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pipeline.run.failures import one_line
from pipeline.run.protocol import Event, Listener, Request, ignore
from pipeline.run.task import Job, StageTask, upstream_first
from pipeline.run.tasks import STAGES, final_tasks
from pipeline.store.artifacts import ArtifactError, completed_at
from schemas.errors import InputError, UnavailableError
from stages.ingest.file_source import file_source
from stages.ingest.sources import DescribedSource, HumanSource, RoboartSource, Source, list_sources
from stages.ingest.truth import truth_files


def plan(request: Request, notify: Listener = ignore) -> list[Job]:
    """Make a job for each requested sequence. A sequence with unreadable input is reported as failed and left out.

    Input that this machine lacks is a failure only if the sequence was requested by name. Otherwise a warning says how
    to get it. Raises InputError if the request cannot be met: unknown sequences or stages, or no data.
    """
    if request.rerun is not None and request.rerun not in STAGES:
        raise InputError(f"stage: found {request.rerun!r}, expected one of {', '.join(STAGES)}")
    jobs = []
    for source in _sources(request):
        try:
            jobs.append(_job(source, request, notify))
        except (InputError, ArtifactError, OSError) as error:
            optional = isinstance(error, UnavailableError) and request.sequences is None
            notify(
                Event(
                    kind="warning" if optional else "failed",
                    sequence=source.name,
                    task="ingest",
                    message=one_line(error),
                    bad_input=isinstance(error, InputError) and not optional,
                )
            )
    return jobs


def _job(source: Source, request: Request, notify: Listener) -> Job:
    config = request.config
    frame_count = source.frame_count(config.ingest)
    job = Job(request.dataset, source, source.digest(), config, request.workdir, notify, frame_count=frame_count)
    if request.rerun is not None:
        job.replaces.update(_completion_times(downstream_of(request.rerun, final_tasks(job))))
    return job


def origin_of(source: Source) -> dict[str, str]:
    """The origin of a sequence: the name of what it shows, and for robots and people its type and split."""
    match source:
        case RoboartSource(thing=robot):
            from stages.ingest.roboart import robot_kind, robot_split

            return {"robot": robot, "type": robot_kind(robot), "split": robot_split(robot)}
        case HumanSource(name=name):
            from stages.ingest.humans import human_kind, human_split

            return {"type": human_kind(name), "split": human_split(name)}
        case DescribedSource(thing=thing):
            return {"robot": thing}
        case _:
            return {}


def downstream_of(stage: str, tasks: Sequence[StageTask]) -> list[StageTask]:
    """The tasks of a stage, and all tasks that depend on them."""
    affected: list[StageTask] = []
    for task in upstream_first(tasks):
        if task.stage == stage or any(needed in affected for needed in task.requires().values()):
            affected.append(task)
    return affected


def _sources(request: Request) -> list[Source]:
    if request.frames is not None:
        source = file_source(request.frames)
        return [source if request.truth is None else replace(source, truth_path=_truth_file(request.truth))]
    sources = {source.name: source for source in list_sources(request.config.ingest, request.data)}
    wanted = request.sequences if request.sequences is not None else tuple(sources)
    unknown = [name for name in wanted if name not in sources]
    if unknown:
        raise InputError(
            f"sequences: found {', '.join(unknown)}, expected some of {', '.join(sources)}; check the spelling"
        )
    return [sources[name] for name in dict.fromkeys(wanted)]


def _truth_file(truth: Path) -> Path:
    """The ground truth's file in a folder, or the path itself. Raises InputError if there is none."""
    inside = truth / "ground_truth.npz"
    found = inside if inside.is_file() else truth
    if not truth_files(found):
        raise InputError(
            f"--truth {truth}: found no ground truth, expected a folder with ground_truth.npz; check the path"
        )
    return found


def _completion_times(tasks: Sequence[StageTask]) -> dict[Path, int]:
    times = {task.directory: completed_at(task.directory) for task in tasks}
    return {directory: time for directory, time in times.items() if time is not None}
