"""The evaluation of a data set, gathered from the artifacts that are there; nothing is computed anew."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from pipeline import store
from pipeline.plan import plan
from pipeline.protocol import Event, Request
from pipeline.status import TaskStatus, task_status
from pipeline.task import Job, StageTask, upstream_first
from pipeline.tasks import EvaluationTask, ReportTask, ResultTask, final_tasks
from schemas.errors import InputError
from schemas.metrics import Metrics
from schemas.scores import Figures, GroupScore, Level, MissingScore, MissingState, Scores, SequenceScore, StageCost
from stages.ingest.roboart import robot_kind, robot_split
from stages.ingest.sources import DescribedSource, RoboartSource, Source, list_sources
from stages.kernels.roc import area_under_roc
from stages.summary import figures_of, mean_costs, mean_figures, total_cost

GROUPING: dict[Level, Callable[[SequenceScore], str | None]] = {
    "robot": lambda score: score.robot,
    "type": lambda score: score.type,
    "split": lambda score: score.split,
    "all": lambda score: "all",
}


def gather(request: Request, split: str | None = None) -> Scores:
    """The evaluation of every sequence of a request that has one, and why the others have none.

    Raises InputError as `plan` does, and for a split that the data set does not have.
    """
    wanted = None if split is None else sequences_of(split, request)
    missing: list[MissingScore] = []

    def note(event: Event) -> None:
        state: MissingState = "failed" if event.kind == "failed" else "unavailable"
        missing.append(MissingScore(sequence=event.sequence, state=state, message=event.message))

    scores = []
    for job in plan(request, note):
        found = score_of(job)
        if isinstance(found, SequenceScore):
            scores.append(found)
        else:
            missing.append(found)
    if wanted is not None:
        scores = [score for score in scores if score.sequence in wanted]
        missing = [entry for entry in missing if entry.sequence in wanted]
    return Scores(
        dataset=request.dataset,
        created=datetime.now(UTC),
        config=request.config.model_dump(mode="json"),
        split=split,
        sequences=tuple(scores),
        missing=tuple(missing),
        groups=tuple(groups_of(scores)),
    )


def sequences_of(split: str, request: Request) -> set[str]:
    """The names of a split's sequences. Raises InputError for a split that the data set does not have."""
    splits = {source.name: _origin(source).get("split") for source in list_sources(request.config.ingest, request.data)}
    names = {name for name, of in splits.items() if of == split}
    if not names:
        known = ", ".join(sorted({of for of in splits.values() if of is not None}))
        expected = f"one of {known}" if known else f"none, as {request.dataset} has no splits; leave it out"
        raise InputError(f"--split: found {split!r}, expected {expected}")
    return names


def score_of(job: Job) -> SequenceScore | MissingScore:
    """The evaluation of one sequence, or why it has none."""
    evaluation, result, report = EvaluationTask(job=job), ResultTask(job=job), ReportTask(job=job)
    tasks = upstream_first(final_tasks(job))
    if not evaluation.complete():
        return _why_missing(job.source.name, [task_status(task) for task in tasks])
    try:
        metrics = store.read(evaluation.directory, Metrics)
    except store.CorruptArtifactError as error:
        return MissingScore(sequence=job.source.name, state="corrupt", message=str(error))
    costs = costs_of(tasks)
    return SequenceScore(
        sequence=job.source.name,
        **_origin(job.source),
        metrics=metrics,
        figures=figures_of(metrics, costs),
        costs=costs,
        result=result.directory.relative_to(job.workdir).as_posix() if result.complete() else None,
        report=report.directory.relative_to(job.workdir).as_posix() if report.complete() else None,
    )


def costs_of(tasks: Sequence[StageTask]) -> dict[str, StageCost]:
    """What each stage took, by the manifests of those tasks whose artifacts are still there, and sound."""
    costs: dict[str, list[StageCost]] = {}
    for task in tasks:
        with contextlib.suppress(store.CorruptArtifactError):
            manifest = store.read_manifest(task.directory)
            cost = StageCost(seconds=sum(manifest.seconds.values()), peak_memory_mib=manifest.peak_memory_mib)
            costs.setdefault(task.stage, []).append(cost)
    return {stage: total_cost(of_stage) for stage, of_stage in costs.items()}


def groups_of(scores: Sequence[SequenceScore]) -> Iterator[GroupScore]:
    """The means of every robot, type and split that the data set tells, and over all."""
    for level, name_of in GROUPING.items():
        groups: dict[str, list[SequenceScore]] = {}
        for score in scores:
            if (name := name_of(score)) is not None:
                groups.setdefault(name, []).append(score)
        for name, group in sorted(groups.items()):
            yield GroupScore(
                level=level, name=name, sequences=len(group), figures=_figures(group), costs=mean_costs(group)
            )


def _figures(group: Sequence[SequenceScore]) -> Figures:
    """The means of a group, and what only all its joints together tell: single sequences have few wrong ones."""
    verdicts = [verdict for score in group for verdict in score.metrics.verdicts]
    confidence = np.array([verdict.confidence for verdict in verdicts], dtype=np.float64)
    right = np.array([verdict.right for verdict in verdicts], dtype=bool)
    return mean_figures(group).model_copy(update={"confidence_auc": area_under_roc(confidence, right)})


def read_scores(path: Path) -> Scores:
    """An evaluation that was written earlier. Raises InputError where the file is not one."""
    advice = "expected an evaluation.json that `reart evaluate` wrote; check the path"
    try:
        return Scores.model_validate_json(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}), {advice}") from error
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, first["loc"])) or "the file"
        raise InputError(f"{path}: {field}: {first['msg']}; {advice}") from error


def _origin(source: Source) -> dict[str, str]:
    """What a sequence shows, where that has a name; of RoboArt's robots the type and the split, too."""
    match source:
        case RoboartSource(thing=robot):
            return {"robot": robot, "type": robot_kind(robot), "split": robot_split(robot)}
        case DescribedSource(thing=thing):
            return {"robot": thing}
        case _:
            return {}


def _why_missing(sequence: str, statuses: Sequence[TaskStatus]) -> MissingScore:
    """The first task that failed or is corrupt tells; else whether anything was computed at all."""
    for status in statuses:
        if status.state in ("failed", "corrupt"):
            return MissingScore(
                sequence=sequence,
                state="failed" if status.state == "failed" else "corrupt",
                message=f"{status.task}: {status.message}",
                log=status.log,
            )
    done = sum(status.state == "done" for status in statuses)
    if any(status.stage == EvaluationTask.stage and status.state == "stale" for status in statuses):
        return MissingScore(
            sequence=sequence, state="stale", message="evaluated with other settings, input or code only; run it"
        )
    return MissingScore(
        sequence=sequence, state="missing", message=f"{done} of {len(statuses)} stages are done; run the rest"
    )
