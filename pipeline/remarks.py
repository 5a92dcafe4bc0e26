"""What the user should know of the models that a run made: in a line each, at its end."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from pipeline import store
from pipeline.launch import Outcome


def remarks(outcome: Outcome) -> Iterator[tuple[str, str]]:
    """(sequence, line) of every model whose description has one; see `stages.export.remarks`."""
    for (sequence, task), directory in outcome.planned.items():
        if task == "export" and store.completed_at(directory) is not None:
            with contextlib.suppress(store.CorruptArtifactError):  # which whoever needs that artifact tells
                for line in store.read_manifest(directory).payload["remarks"]:
                    yield sequence, line
