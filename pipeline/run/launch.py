"""The command line's side of a run: start the engine, follow its events, and return the outcome."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from pipeline.run.place import Place
from pipeline.run.processes import ONE_THREAD, how_it_ended
from pipeline.run.protocol import Event, Request
from pipeline.store import artifacts

FAILED, BAD_INPUT = 1, 2


@dataclass
class Outcome:
    """The planned artifacts of a run, and its failures."""

    folder: Path
    planned: dict[tuple[str, str], Place] = field(default_factory=dict)
    origins: dict[str, dict[str, str]] = field(default_factory=dict)
    failures: dict[tuple[str, str], Event] = field(default_factory=dict)
    unavailable: dict[str, str] = field(default_factory=dict)
    refused: str = ""
    died: str = ""

    def note(self, event: Event) -> None:
        if event.kind == "planned":
            directory = self.folder / event.sequence / event.artifact
            self.planned[event.sequence, event.task] = Place(event.sequence, event.task, directory)
            self.origins[event.sequence] = event.origin
        elif event.kind == "failed":
            self.failures.setdefault((event.sequence, event.task), event)  # the first failure is the cause
        elif event.kind == "warning" and not event.artifact:
            self.unavailable[event.sequence] = event.message
        elif event.kind == "refused":
            self.refused = event.message

    def incomplete(self) -> list[tuple[str, str]]:
        """(sequence, task) of each missing artifact, as found on the disk rather than reported by the engine."""
        return [task for task, place in self.planned.items() if not self.is_complete(place)]

    def is_complete(self, place: Place) -> bool:
        """Whether an artifact is complete. One that this process may not read counts as incomplete."""
        with contextlib.suppress(artifacts.UnreadableArtifactError):
            return artifacts.completed_at(place.directory) is not None
        return False

    def places_of(self, sequence: str) -> list[Place]:
        """The places of a sequence's artifacts, each after the ones that it was made from."""
        return [place for place in self.planned.values() if place.sequence == sequence]

    def exit_code(self) -> int:
        """The exit code: 0 if everything is complete, 2 if only the user's input was wrong, 1 for other failures."""
        if self.refused:
            return BAD_INPUT
        if self.died:
            return FAILED
        if self.failures:
            return BAD_INPUT if all(failure.bad_input for failure in self.failures.values()) else FAILED
        if not self.planned:
            return BAD_INPUT
        return FAILED if self.incomplete() else 0

    def log_of(self, failure: Event) -> Path | None:
        """The log of a failed task; None if it failed before it had one."""
        if not failure.artifact:
            return None
        return self.folder / failure.sequence / f"{failure.artifact}.log"


def run(request: Request, on_event: Callable[[Event], None]) -> Outcome:
    """Run the engine to its end. No process of the run is left when this returns or raises."""
    outcome = Outcome(request.workdir / request.dataset)
    reading, writing = os.pipe()
    with open(reading, "rb") as events, tempfile.TemporaryFile() as words:
        engine = subprocess.Popen(
            [sys.executable, "-P", "-m", "pipeline.run.engine", str(writing), str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=words,
            stderr=words,
            pass_fds=[writing],
            env=os.environ | ONE_THREAD,
        )
        os.close(writing)
        try:
            _send(engine, request)
            for line in events:
                event = Event.model_validate_json(line)
                outcome.note(event)
                on_event(event)
        except BaseException:
            engine.kill()
            events.read()  # every worker holds the pipe open, so it ends with the last of them
            artifacts.sweep(request.workdir)
            raise
        finally:
            code = engine.wait()
        if code != 0:
            outcome.died = f"the engine ended unexpectedly ({how_it_ended(code)}){_last_line(words)}"
    return outcome


def _send(engine: subprocess.Popen[bytes], request: Request) -> None:
    assert engine.stdin is not None
    with contextlib.suppress(BrokenPipeError), engine.stdin as stdin:  # a dead engine is noticed later
        stdin.write(request.model_dump_json().encode())


def _last_line(words: IO[bytes]) -> str:
    words.seek(0)
    lines = words.read().decode(errors="replace").split("\n")
    return next((f": {line.strip()}" for line in reversed(lines) if line.strip()), "")
