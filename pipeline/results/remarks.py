"""Remarks on the models of a run, printed at its end."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from pipeline.run.launch import Outcome
from pipeline.store import artifacts


def remarks(outcome: Outcome) -> Iterator[tuple[str, str]]:
    """Yield (sequence, line) for every remark on an exported model; see `stages.export.remarks`."""
    for place in outcome.planned.values():
        if place.stage == "export" and outcome.is_complete(place):
            with contextlib.suppress(artifacts.ArtifactError):  # reported where the artifact is needed
                for line in artifacts.read_manifest(place.directory).payload["remarks"]:
                    yield place.sequence, line
