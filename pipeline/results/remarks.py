"""What the user should know of the models that a run made: in a line each, at its end."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from pipeline.run.launch import Outcome
from pipeline.store import artifacts


def remarks(outcome: Outcome) -> Iterator[tuple[str, str]]:
    """(sequence, line) of every model whose description has one; see `stages.export.remarks`."""
    for place in outcome.planned.values():
        if place.stage == "export" and outcome.is_complete(place):
            with contextlib.suppress(artifacts.ArtifactError):  # which whoever needs that artifact tells
                for line in artifacts.read_manifest(place.directory).payload["remarks"]:
                    yield place.sequence, line
