import pytest

from pipeline.run.estimate import Estimate
from pipeline.run.protocol import Event


def event(kind, sequence, task, **more):
    return Event(kind=kind, sequence=sequence, task=task, **more)


@pytest.fixture
def estimate():
    def planned(workers, *tasks):
        estimate = Estimate(workers)
        for sequence, task in tasks:
            estimate.note(event("planned", sequence, task), 0.0)
        return estimate

    return planned


def finish(estimate, sequence, task, seconds):
    estimate.note(event("started", sequence, task), 0.0)
    estimate.note(event("finished", sequence, task, seconds=seconds), seconds)


def test_nothing_is_told_before_every_stage_ahead_was_seen_once(estimate):
    running = estimate(1, ("a", "flow"), ("a", "merging"), ("b", "flow"), ("b", "merging"))
    finish(running, "a", "flow", 10)
    assert running.remaining(10) is None
    finish(running, "a", "merging", 2)
    assert running.remaining(12) == pytest.approx(12)


def test_the_time_that_a_running_stage_has_run_is_taken_off_but_never_more_than_it_takes(estimate):
    running = estimate(1, ("a", "flow"), ("b", "flow"))
    finish(running, "a", "flow", 10)
    running.note(event("started", "b", "flow"), 10.0)
    assert running.remaining(14) == pytest.approx(6)
    assert running.remaining(50) == 0


def test_workers_share_the_work_but_one_sequence_is_a_chain_with_its_candidates_side_by_side(estimate):
    tasks = [(name, task) for name in "abcd" for task in ("flow", "fit[0]", "fit[1]")]
    running = estimate(2, *tasks)
    for task in ("flow", "fit[0]", "fit[1]"):
        finish(running, "a", task, 10)
    assert running.remaining(30) == pytest.approx(45)
    for name in "bc":
        for task in ("flow", "fit[0]", "fit[1]"):
            finish(running, name, task, 10)
    assert running.remaining(90) == pytest.approx(20)


def test_what_is_complete_already_or_waits_for_a_failed_stage_takes_no_time(estimate):
    running = estimate(1, ("a", "flow"), ("b", "flow"), ("b", "merging"), ("c", "flow"))
    running.note(event("planned", "d", "flow", complete=True), 0.0)
    finish(running, "a", "flow", 10)
    running.note(event("started", "b", "flow"), 10.0)
    running.note(event("failed", "b", "flow"), 11.0)
    assert running.remaining(11) == pytest.approx(10)
