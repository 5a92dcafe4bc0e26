"""The display of a run: a line for each finished stage with the time left, and on a terminal bars with energies."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from pipeline.run.estimate import Estimate
from pipeline.run.protocol import Event


class RunDisplay:
    """Show the events of a run. Call it with each event, inside its context."""

    def __init__(self, console: Console, workers: int = 1) -> None:
        self.console = console
        self.estimate = Estimate(workers)
        self.pending = 0
        self.ended = 0
        self.overall: TaskID | None = None
        self.bars: dict[tuple[str, str], TaskID] = {}
        self.progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[energy]}"),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )

    def __enter__(self) -> Self:
        self.progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.progress.stop()

    def __call__(self, event: Event) -> None:
        name = (event.sequence, event.task)
        self.estimate.note(event, time.monotonic())
        if event.kind == "planned":
            self.pending += not event.complete
        elif event.kind == "started":
            if self.overall is None:
                self.overall = self.progress.add_task("all stages", energy="")
            self.bars[name] = self.progress.add_task(escape(" ".join(name)), total=None, energy="")
        elif event.kind == "progress" and name in self.bars:
            energy = "" if event.energy is None else f"E {event.energy:.4g}"
            self.progress.update(self.bars[name], completed=event.done, total=event.total, energy=energy)
        elif event.kind == "warning":
            self.console.print(escape(f"warning: {' '.join(name)}: {event.message}"), soft_wrap=True)
        elif event.kind in ("finished", "failed"):
            self._end(event)
        if self.overall is not None:
            self.progress.update(self.overall, completed=self.ended, total=self.pending, energy=self._time_left())

    def _end(self, event: Event) -> None:
        bar = self.bars.pop((event.sequence, event.task), None)
        if bar is not None:
            self.progress.remove_task(bar)
        self.ended += bool(event.artifact)
        end = "[red]failed[/red]" if event.kind == "failed" else f"{event.seconds:.1f} s"
        count = f"{self.ended:>{len(str(self.pending))}}/{self.pending}"
        words = (count, escape(event.sequence), escape(event.task), end, self._time_left())
        self.console.print("  ".join(filter(None, words)), soft_wrap=True)

    def _time_left(self) -> str:
        return time_left(self.estimate.remaining(time.monotonic()))


def time_left(seconds: float | None) -> str:
    """Format the remaining time with the precision of an estimate. The text is empty if it is unknown or over."""
    if not seconds:
        return ""
    minutes = round(seconds / 60)
    if minutes < 1:
        return "less than a minute left"
    return f"about {minutes // 60} h {minutes % 60:02} min left" if minutes >= 60 else f"about {minutes} min left"
