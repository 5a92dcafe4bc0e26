import pytest

from pipeline.run.launch import Outcome
from pipeline.run.protocol import Event


@pytest.fixture
def outcome(tmp_path):
    """One sequence of two tasks, both complete."""
    outcome = Outcome(tmp_path)
    for artifact in ("flow-0", "result-0"):
        directory = tmp_path / "box" / artifact
        directory.mkdir(parents=True)
        (directory / "manifest.json").write_text("{}")
        outcome.note(Event(kind="planned", sequence="box", task=artifact[:-2], artifact=artifact))
    return outcome


def failed(bad_input):
    return Event(kind="failed", sequence="lamp", task="ingest", artifact="ingest-0", bad_input=bad_input)


def test_a_run_succeeds_where_everything_that_was_planned_is_on_the_disk(outcome, tmp_path):
    assert (outcome.exit_code(), outcome.incomplete()) == (0, [])
    (tmp_path / "box" / "flow-0" / "manifest.json").unlink()
    assert (outcome.exit_code(), outcome.incomplete()) == (1, [("box", "flow")])


def test_any_failure_is_an_exit_code_of_1_unless_all_are_bad_input(outcome):
    outcome.note(failed(bad_input=True))
    assert outcome.exit_code() == 2
    outcome.note(Event(kind="failed", sequence="other", task="flow", artifact="flow-0"))
    assert outcome.exit_code() == 1


def test_a_failure_counts_though_an_older_artifact_is_complete(outcome):
    outcome.note(Event(kind="failed", sequence="box", task="flow", artifact="flow-0"))
    assert outcome.exit_code() == 1


def test_a_dead_engine_a_refusal_and_nothing_to_do_are_no_success(outcome, tmp_path):
    outcome.died = "killed"
    assert outcome.exit_code() == 1
    outcome.note(Event(kind="refused", message="no"))
    assert outcome.exit_code() == 2
    assert Outcome(tmp_path).exit_code() == 2


def test_a_failed_task_has_its_log_beside_its_artifact(outcome, tmp_path):
    assert outcome.log_of(failed(bad_input=True)) == tmp_path / "lamp" / "ingest-0.log"
    assert outcome.log_of(Event(kind="failed", sequence="lamp", task="ingest")) is None


def test_the_first_failure_of_a_task_is_its_cause(outcome):
    outcome.note(failed(bad_input=True))
    outcome.note(failed(bad_input=True).model_copy(update={"message": "its process ended"}))
    assert [failure.message for failure in outcome.failures.values()] == [""]
