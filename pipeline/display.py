"""What a run shows while it lasts: bars with the current energy on a terminal, else one line a finished stage."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from pipeline.protocol import Event


class RunDisplay:
    """Called with every event of a run; a context manager around it."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self.pending = 0
        self.ended = 0
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
        if event.kind == "planned":
            self.pending += not event.complete
        elif event.kind == "started":
            self.bars[name] = self.progress.add_task(escape(" ".join(name)), total=None, energy="")
        elif event.kind == "progress" and name in self.bars:
            energy = "" if event.energy is None else f"E {event.energy:.4g}"
            self.progress.update(self.bars[name], completed=event.done, total=event.total, energy=energy)
        elif event.kind == "warning":
            self.console.print(escape(f"warning: {' '.join(name)}: {event.message}"), soft_wrap=True)
        elif event.kind in ("finished", "failed"):
            self._end(event)

    def _end(self, event: Event) -> None:
        bar = self.bars.pop((event.sequence, event.task), None)
        if bar is not None:
            self.progress.remove_task(bar)
        self.ended += bool(event.artifact)
        end = "[red]failed[/red]" if event.kind == "failed" else f"{event.seconds:.1f} s"
        count = f"{self.ended:>{len(str(self.pending))}}/{self.pending}"
        self.console.print(f"{count}  {escape(event.sequence)}  {escape(event.task)}  {end}", soft_wrap=True)
