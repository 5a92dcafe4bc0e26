import pytest

from pipeline.cli.run import evaluation_of
from pipeline.run.launch import Outcome
from pipeline.run.protocol import Event
from pipeline.run.task import upstream_first
from pipeline.run.tasks import final_tasks


@pytest.fixture
def outcome(evaluated):
    """A run of all robots on a machine that has bolt's description only; ur5's could not be read."""
    outcome = Outcome(evaluated.workdir / "roboart")
    for task in upstream_first(final_tasks(evaluated.job("bolt"))):
        planned = Event(kind="planned", sequence="bolt", task=task.label, artifact=task.directory.name)
        outcome.note(planned)
    outcome.note(Event(kind="warning", sequence="bolt", task="flow", artifact="flow-0", message="odd points"))
    outcome.note(Event(kind="warning", sequence="a1", task="ingest", message="found no URDF"))
    outcome.note(Event(kind="failed", sequence="ur5", task="ingest", message="not XML", bad_input=True))
    return outcome


def test_the_evaluation_of_a_run_tells_of_all_that_it_was_to_make(evaluated, outcome):
    evaluated.lacked.update(("ur5", "a1"))
    scores = evaluation_of(evaluated.request().model_copy(update={"sequences": None}), outcome)
    assert [score.sequence for score in scores.sequences] == ["bolt"]
    states = {entry.sequence: (entry.state, entry.message) for entry in scores.missing}
    assert set(states) == {"ur5", "a1"}
    assert states["ur5"][0] == "failed"
    assert states["a1"] == ("unavailable", "found no URDF")


def test_what_a_rerun_made_anew_counts_as_made(evaluated, outcome):
    request = evaluated.request("bolt").model_copy(update={"rerun": "evaluation"})
    assert "bolt" in [score.sequence for score in evaluation_of(request, outcome).sequences]
