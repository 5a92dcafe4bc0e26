"""Which task comes first, where more could be computed than there are workers."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.run.task import StageTask, upstream_first


def prioritise(ends: Sequence[Sequence[StageTask]], workers: int) -> None:
    """Give all tasks that these need their priority; `ends` are the last tasks of each sequence.

    One sequence keeps few workers busy, because its stages wait for one another. Were sequences finished one by
    one, most workers would idle during the last. So the more workers there are, the farther the early stages of
    later sequences run ahead of the last stages of earlier ones: what remains at the end is short and independent.
    """
    for rank, tasks in enumerate(reversed(ends), start=1):
        for task, height in heights(tasks).items():
            task.priority = (workers - 1) * height + rank


def heights(tasks: Sequence[StageTask]) -> dict[StageTask, int]:
    """How many tasks wait for each, one after the other; for these and all that they need."""
    ordered = upstream_first(tasks)
    height = dict.fromkeys(ordered, 0)
    for task in reversed(ordered):
        for needed in task.requires().values():
            height[needed] = max(height[needed], height[task] + 1)
    return height
