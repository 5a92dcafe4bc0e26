"""Estimation of a run's remaining time from the time that its stages took so far."""

from __future__ import annotations

from pipeline.run.place import stage_of
from pipeline.run.protocol import Event

Task = tuple[str, str]


class Estimate:
    """Estimate of the remaining time, which follows a run's events. Times are seconds of the caller's clock."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self.waiting: set[Task] = set()
        self.running: dict[Task, float] = {}
        self.seconds: dict[str, list[float]] = {}

    def note(self, event: Event, now: float) -> None:
        """Update the estimate by one event."""
        task = (event.sequence, event.task)
        if event.kind == "planned" and not event.complete:
            self.waiting.add(task)
        elif event.kind == "started":
            self.waiting.discard(task)
            self.running[task] = now
        elif event.kind == "finished":
            self.running.pop(task, None)
            self.seconds.setdefault(stage_of(event.task), []).append(event.seconds)
        elif event.kind == "failed":
            self.running.pop(task, None)
            self.waiting = {other for other in self.waiting if other[0] != event.sequence}  # most of them need it

    def remaining(self, now: float) -> float | None:
        """Seconds to the end; None while some remaining stage has no finished example yet.

        The estimate assumes that all workers share the work evenly, and that each sequence's stages run one by one.
        """
        left = {task: self._expected(task) for task in self.waiting}
        for task, start in self.running.items():
            expected = self._expected(task)
            left[task] = None if expected is None else max(0.0, expected - (now - start))
        known = {task: seconds for task, seconds in left.items() if seconds is not None}
        if len(known) < len(left):
            return None
        chains = (_chain(known, sequence) for sequence in {sequence for sequence, _ in known})
        return max(sum(known.values()) / self.workers, *chains, 0.0)

    def _expected(self, task: Task) -> float | None:
        seconds = self.seconds.get(stage_of(task[1]))
        return None if seconds is None else sum(seconds) / len(seconds)


def _chain(seconds: dict[Task, float], sequence: str) -> float:
    """The time that one sequence needs if its candidates run in parallel."""
    longest: dict[str, float] = {}
    for (of, task), duration in seconds.items():
        if of == sequence:
            longest[stage_of(task)] = max(duration, longest.get(stage_of(task), 0.0))
    return sum(longest.values())
