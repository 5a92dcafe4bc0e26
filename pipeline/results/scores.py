"""The evaluation of a data set, gathered from existing artifacts. Nothing is computed."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import ValidationError

from pipeline.results.status import TaskStatus, task_status
from pipeline.run.place import Place
from pipeline.run.plan import origin_of, plan
from pipeline.run.protocol import Event, Request
from pipeline.run.task import Job, upstream_first
from pipeline.run.tasks import EvaluationTask, ReportTask, ResultTask, final_tasks
from pipeline.store import artifacts
from pipeline.store.files import read_whole
from schemas.errors import InputError, first_fault
from schemas.metrics import Metrics
from schemas.scores import Figures, GroupScore, Level, MissingScore, MissingState, Scores, SequenceScore, StageCost
from stages.evaluation.roc import area_under_roc
from stages.evaluation.summary import figures_of, mean_costs, mean_figures, total_cost
from stages.ingest.sources import list_sources

GROUPING: dict[Level, Callable[[SequenceScore], str | None]] = {
    "robot": lambda score: score.robot,
    "type": lambda score: score.type,
    "split": lambda score: score.split,
    "all": lambda score: "all",
}


@dataclass(frozen=True)
class PlannedSequence:
    """A sequence to be evaluated: its origin and the places of its artifacts."""

    name: str
    origin: Mapping[str, str]
    places: Sequence[Place]

    @classmethod
    def of(cls, job: Job) -> Self:
        return cls(job.source.name, origin_of(job.source), [task.place for task in upstream_first(final_tasks(job))])


def gather(request: Request, split: str | None = None) -> Scores:
    """Gather the evaluations of a request's sequences, and the reasons for missing ones.

    Raises InputError as `plan` does, and for a split that the data set does not have.
    """
    wanted = None if split is None else sequences_of(split, request)
    missing: list[MissingScore] = []

    def note(event: Event) -> None:
        state: MissingState = "failed" if event.kind == "failed" else "unavailable"
        missing.append(MissingScore(sequence=event.sequence, state=state, message=event.message))

    planned = [PlannedSequence.of(job) for job in plan(request, note)]
    if wanted is not None:
        planned = [sequence for sequence in planned if sequence.name in wanted]
        missing = [entry for entry in missing if entry.sequence in wanted]
    return scores_of(request, planned, missing, split)


def scores_of(
    request: Request, planned: Iterable[PlannedSequence], missing: Sequence[MissingScore], split: str | None = None
) -> Scores:
    """Gather the evaluations of planned sequences. `missing` ones are known already. No input is read."""
    found = [score_of(sequence) for sequence in planned]
    scores = [entry for entry in found if isinstance(entry, SequenceScore)]
    return Scores(
        dataset=request.dataset,
        created=datetime.now(UTC),
        config=request.config.model_dump(mode="json"),
        split=split,
        sequences=tuple(scores),
        missing=(*missing, *(entry for entry in found if isinstance(entry, MissingScore))),
        groups=tuple(groups_of(scores)),
    )


def sequences_of(split: str, request: Request) -> set[str]:
    """The names of a split's sequences. Raises InputError if the data set does not have the split."""
    sources = list_sources(request.config.ingest, request.data)
    splits = {source.name: origin_of(source).get("split") for source in sources}
    names = {name for name, of in splits.items() if of == split}
    if not names:
        known = ", ".join(sorted({of for of in splits.values() if of is not None}))
        expected = f"one of {known}" if known else f"none, as {request.dataset} has no splits; leave it out"
        raise InputError(f"--split: found {split!r}, expected {expected}")
    return names


def score_of(planned: PlannedSequence) -> SequenceScore | MissingScore:
    """The evaluation of one sequence, or the reason why it has none."""
    statuses = [task_status(place) for place in planned.places]
    directories = {place.stage: place.directory for place in planned.places}
    done = {status.stage for status in statuses if status.state == "done"}
    if EvaluationTask.stage not in done:
        return _why_missing(planned.name, statuses)
    try:
        metrics = artifacts.read(directories[EvaluationTask.stage], Metrics)
    except artifacts.ArtifactError as error:
        return MissingScore(sequence=planned.name, state=_state_of(error), message=str(error))
    costs = costs_of(planned.places)

    def folder(stage: str) -> str | None:
        """The folder of a stage's artifact relative to the working directory: data set, sequence, artifact."""
        return Path(*directories[stage].parts[-3:]).as_posix() if stage in done else None

    return SequenceScore(
        sequence=planned.name,
        **planned.origin,
        metrics=metrics,
        figures=figures_of(metrics, costs),
        costs=costs,
        result=folder(ResultTask.stage),
        report=folder(ReportTask.stage),
    )


def costs_of(places: Sequence[Place]) -> dict[str, StageCost]:
    """The cost of each stage, from the manifests of existing intact artifacts."""
    costs: dict[str, list[StageCost]] = {}
    for place in places:
        with contextlib.suppress(artifacts.ArtifactError):
            manifest = artifacts.read_manifest(place.directory)
            cost = StageCost(seconds=sum(manifest.seconds.values()), peak_memory_mib=manifest.peak_memory_mib)
            costs.setdefault(place.stage, []).append(cost)
    return {stage: total_cost(of_stage) for stage, of_stage in costs.items()}


def groups_of(scores: Sequence[SequenceScore]) -> Iterator[GroupScore]:
    """Yield the means over every robot, type and split that the data set defines, and over all sequences."""
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
    """The means of a group, and the AUC of all its joints together: one sequence has too few wrong joints for that."""
    verdicts = [verdict for score in group for verdict in score.metrics.verdicts]
    confidence = np.array([verdict.confidence for verdict in verdicts], dtype=np.float64)
    right = np.array([verdict.right for verdict in verdicts], dtype=bool)
    return mean_figures(group).model_copy(update={"confidence_auc": area_under_roc(confidence, right)})


def read_scores(path: Path) -> Scores:
    """Read an earlier evaluation. Raises InputError if the file is not one."""
    advice = "expected an evaluation.json that `reart evaluate` wrote; check the path"
    try:
        return Scores.model_validate_json(read_whole(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}), {advice}") from error
    except ValidationError as error:
        raise InputError(f"{path}: {first_fault(error)}; {advice}") from error


def _state_of(error: artifacts.ArtifactError) -> MissingState:
    return "corrupt" if isinstance(error, artifacts.CorruptArtifactError) else "unreadable"


def _why_missing(sequence: str, statuses: Sequence[TaskStatus]) -> MissingScore:
    """Explain a missing evaluation by the first failed task or unusable artifact, or say that it was not computed."""
    for status in statuses:
        if status.state in ("failed", "corrupt", "unreadable"):
            message = f"{status.task}: {status.message}"
            return MissingScore(sequence=sequence, state=status.state, message=message, log=status.log)
    done = sum(status.state == "done" for status in statuses)
    if any(status.stage == EvaluationTask.stage and status.state == "stale" for status in statuses):
        return MissingScore(
            sequence=sequence, state="stale", message="evaluated with other settings, input or code only; run it"
        )
    return MissingScore(
        sequence=sequence, state="missing", message=f"{done} of {len(statuses)} stages are done; run the rest"
    )
