import pytest

from pipeline.results.status import task_status
from schemas.config import FinalFitConfig, PipelineConfig
from schemas.errors import InputError


def states(tasks):
    return {task.label: task_status(task.place).state for task in tasks}


def test_before_a_run_everything_is_missing(tiny):
    assert set(states(tiny.tasks(tiny.job())).values()) == {"missing"}


def test_after_a_run_everything_is_done_and_has_its_seconds(tiny):
    tasks = tiny.finish(tiny.job())
    assert set(states(tasks).values()) == {"done"}
    assert all(task_status(task.place).seconds > 0 for task in tasks)


def test_what_is_there_with_other_settings_only_is_stale(tiny):
    tiny.finish(tiny.job())
    changed = tiny.tasks(tiny.job(PipelineConfig(final_fit=FinalFitConfig(iterations=3))))
    assert states(changed) == {"ingest": "done", "merging[0]": "done", "merging[1]": "done", "final_fit": "stale"}


def test_a_failure_is_shown_with_its_reason_and_log(tiny, number_source):
    first, middle, *_ = tiny.tasks(tiny.job(source=number_source(refuses="load")))
    with pytest.raises(InputError):
        first.run()
    status = task_status(first.place)
    assert (status.state, status.message, status.log) == ("failed", "frame.ply: found nothing", str(first.place.log))
    assert task_status(middle.place).state == "missing"


def test_a_broken_failure_record_or_manifest_is_told_not_raised(tiny):
    first, *_ = tiny.finish(tiny.job())
    (first.directory / "manifest.json").write_text("{")
    assert task_status(first.place).state == "corrupt"
    (first.directory / "manifest.json").unlink()
    first.place.failure.write_text("{")
    assert "cannot be read" in task_status(first.place).message


def test_an_artifact_that_cannot_be_looked_into_is_told_not_raised(tiny):
    first, *_ = tiny.tasks(tiny.job())
    first.directory.parent.mkdir(parents=True)
    first.directory.symlink_to(first.directory.name)
    assert task_status(first.place).state == "unreadable"


def test_a_changed_or_missing_file_is_told_where_every_file_is_read(tiny):
    first, middle, *_ = tiny.finish(tiny.job())
    (first.directory / "arrays.zarr" / "values" / "c" / "0").write_bytes(b"changed")
    (middle.directory / "arrays.zarr" / "values" / "c" / "0").unlink()
    assert [task_status(task.place).state for task in (first, middle)] == ["done", "done"]
    assert [task_status(task.place, check=True).state for task in (first, middle)] == ["corrupt", "corrupt"]
