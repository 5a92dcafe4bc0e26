"""Verdicts on the models of a run, and remarks on them and on the input, printed at its end."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from pipeline.run.launch import Outcome
from pipeline.store import artifacts
from schemas.assessment import Verdict


def remarks(outcome: Outcome) -> Iterator[tuple[str, str]]:
    """Yield (sequence, line) for every remark on an ingested sequence or on an exported model."""
    for place in outcome.planned.values():
        if place.stage in ("ingest", "export") and outcome.is_complete(place):
            with contextlib.suppress(artifacts.ArtifactError):  # reported where the artifact is needed
                payload = artifacts.read_manifest(place.directory).payload
                for line in payload.get("sequence", payload)["remarks"]:
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
