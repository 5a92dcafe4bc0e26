"""Priorities of tasks, for when more are ready than there are workers."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.run.task import StageTask, upstream_first


def prioritise(ends: Sequence[Sequence[StageTask]], workers: int) -> None:
    """Set the priority of `ends`, the last tasks of each sequence, and of all tasks that they need.

    One sequence keeps few workers busy, because its stages wait for one another. If sequences were finished one by
    one, most workers would idle during the last one. So early stages of later sequences run ahead of the last stages of
    earlier ones, the farther the more workers there are. The tasks that remain at the end are short and independent.
    """
    for rank, tasks in enumerate(reversed(ends), start=1):
        for task, height in heights(tasks).items():
            task.priority = (workers - 1) * height + rank


def heights(tasks: Sequence[StageTask]) -> dict[StageTask, int]:
    """The length of the longest chain of tasks that wait for each task, for these and all that they need."""
    ordered = upstream_first(tasks)
    height = dict.fromkeys(ordered, 0)
    for task in reversed(ordered):
        for needed in task.requires().values():
            height[needed] = max(height[needed], height[task] + 1)
    return height
