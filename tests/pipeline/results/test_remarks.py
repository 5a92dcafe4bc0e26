from datetime import UTC, datetime

from pipeline.results.remarks import remarks, verdicts
from pipeline.run.launch import Outcome
from pipeline.run.protocol import Event
from pipeline.store import artifacts
from schemas.manifest import Provenance


def provenance_of(name, stage):
    return Provenance(
        stage=stage,
        version=1,
        dataset="scans",
        sequence=name,
        key="k",
        parameters={},
        config={},
        upstream={},
        seed=0,
        created=datetime.now(UTC),
        seconds={},
        peak_memory_mib=1,
        packages={},
    )


def test_what_the_descriptions_of_a_run_say_is_told_by_sequence(tmp_path, samples):
    outcome = Outcome(tmp_path)
    for name, lines in (("plain", ()), ("huge", ("the robot is huge", "nothing moved"))):
        directory = tmp_path / name / "export-k"
        artifacts.publish(directory, samples["robot"].replace(remarks=lines), provenance_of(name, "export"))
        outcome.note(Event(kind="planned", sequence=name, task="export", artifact="export-k"))
        outcome.note(Event(kind="planned", sequence=name, task="result", artifact="result-k"))
    outcome.note(Event(kind="planned", sequence="failed", task="export", artifact="export-k"))
    assert list(remarks(outcome)) == [("huge", "the robot is huge"), ("huge", "nothing moved")]


def test_the_verdicts_of_a_run_are_told_by_sequence(tmp_path, samples):
    outcome = Outcome(tmp_path)
    artifacts.publish(tmp_path / "lamp" / "assessment-k", samples["assessment"], provenance_of("lamp", "assessment"))
    for name in ("lamp", "failed"):
        outcome.note(Event(kind="planned", sequence=name, task="assessment", artifact="assessment-k"))
    assert list(verdicts(outcome)) == [("lamp", samples["assessment"].verdict)]
