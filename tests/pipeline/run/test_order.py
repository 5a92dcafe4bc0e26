import pytest

from pipeline.run.order import heights, prioritise
from pipeline.run.task import upstream_first


@pytest.fixture
def sequences(tiny, number_source):
    """The last task of three sequences."""
    return [[tiny.tasks(tiny.job(source=number_source(name)))[-1]] for name in "abc"]


def order(ends, workers):
    """What one worker would compute, one task after the other, as Luigi picks them."""
    prioritise(ends, workers)
    waiting = upstream_first(task for tasks in ends for task in tasks)
    picked = []
    while waiting:
        ready = [task for task in waiting if not any(needed in waiting for needed in task.requires().values())]
        picked.append(max(ready, key=lambda task: task.priority))
        waiting.remove(picked[-1])
    return "".join(task.job.source.name for task in picked), [task.stage for task in picked]


def test_a_task_is_as_high_as_the_longest_chain_that_waits_for_it(sequences):
    found = {task.label: height for task, height in heights(sequences[0]).items()}
    assert found == {"ingest": 2, "merging[0]": 1, "merging[1]": 1, "final_fit": 0}


def test_one_worker_finishes_sequence_by_sequence(sequences):
    assert order(sequences, 1)[0] == "aaaabbbbcccc"


def test_two_workers_begin_the_next_sequence_before_they_finish_one(sequences):
    names, stages = order(sequences, 2)
    assert names.index("b") < names.rindex("a")
    assert stages.index("final_fit") < len(stages) - 3  # yet do not keep all sequences waiting for one another


def test_many_workers_leave_only_independent_tasks_to_the_end(sequences):
    assert order(sequences, 8)[1] == ["ingest"] * 3 + ["merging"] * 6 + ["final_fit"] * 3


def test_the_same_stages_come_in_the_order_of_the_sequences(sequences):
    names, stages = order(sequences, 8)
    assert [name for name, stage in zip(names, stages, strict=True) if stage == "final_fit"] == ["a", "b", "c"]
