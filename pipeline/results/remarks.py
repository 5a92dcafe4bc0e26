"""Verdicts and remarks on the models of a run, printed at its end."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from pipeline.run.launch import Outcome
from pipeline.store import artifacts
from schemas.assessment import Verdict


def remarks(outcome: Outcome) -> Iterator[tuple[str, str]]:
    """Yield (sequence, line) for every remark on an exported model; see `stages.export.remarks`."""
    for place in outcome.planned.values():
        if place.stage == "export" and outcome.is_complete(place):
            with contextlib.suppress(artifacts.ArtifactError):  # reported where the artifact is needed
                for line in artifacts.read_manifest(place.directory).payload["remarks"]:
                    yield place.sequence, line


def verdicts(outcome: Outcome) -> Iterator[tuple[str, Verdict]]:
    """Yield (sequence, verdict) for every model."""
    for place in outcome.planned.values():
        if place.stage == "assessment" and outcome.is_complete(place):
            with contextlib.suppress(artifacts.ArtifactError):
                yield (
                    place.sequence,
                    Verdict.model_validate(artifacts.read_manifest(place.directory).payload["verdict"]),
                )
