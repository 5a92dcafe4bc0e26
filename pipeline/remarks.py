"""What the user should know of the models that a run made: in a line each, at its end."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from pipeline import store
from pipeline.launch import Outcome


def remarks(outcome: Outcome) -> Iterator[tuple[str, str]]:
    """(sequence, line) of every model whose description has one; see `stages.export.remarks`."""
    for place in outcome.planned.values():
        if place.stage == "export" and outcome.is_complete(place):
            with contextlib.suppress(store.ArtifactError):  # which whoever needs that artifact tells
                for line in store.read_manifest(place.directory).payload["remarks"]:
                    yield place.sequence, line
