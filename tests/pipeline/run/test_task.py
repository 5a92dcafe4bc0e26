import errno

import numpy as np
import pytest

from pipeline.run.plan import downstream_of
from pipeline.run.task import upstream_first
from pipeline.store import artifacts
from schemas.config import FinalFitConfig, MergingConfig, PipelineConfig
from schemas.errors import InputError
from schemas.manifest import Failure


def keys(tiny, config):
    return {task.label: task.key for task in tiny.tasks(tiny.job(config))}


def kinds(tiny):
    return [(event.kind, event.task) for event in tiny.events]


def test_a_task_publishes_what_it_computed_and_where_it_came_from(tiny):
    *_, last = tiny.finish(tiny.job(PipelineConfig(seed=3)))
    assert last.complete()
    assert len(last.read().values) == 8
    manifest = artifacts.read_manifest(last.directory)
    assert last.directory == tiny.workdir / "scans" / "box" / f"final_fit-{last.key}"
    assert manifest.upstream == {name: task.key for name, task in last.requires().items()}
    assert (manifest.seed, manifest.config["merging"]["threshold"]) == (3, MergingConfig().threshold)
    assert set(manifest.seconds) == {"read", "compute"}
    assert 10 < manifest.peak_memory_mib < 100_000
    assert {"python", "numpy", "zarr"} <= set(manifest.packages)
    assert "model.json" in manifest.files


def test_a_setting_changes_the_keys_of_its_stage_and_of_what_follows_only(tiny):
    base = keys(tiny, PipelineConfig())
    final = keys(tiny, PipelineConfig(final_fit=FinalFitConfig(iterations=3)))
    merging = keys(tiny, PipelineConfig(merging=MergingConfig(threshold=0.5)))
    seed = keys(tiny, PipelineConfig(seed=1))
    assert {label for label in base if base[label] != final[label]} == {"final_fit"}
    assert {label for label in base if base[label] != merging[label]} == {"merging[0]", "merging[1]", "final_fit"}
    assert not set(base.values()) & set(seed.values())


def test_the_key_covers_the_source_and_the_candidate(tiny, number_source):
    base = keys(tiny, PipelineConfig())
    assert base["merging[0]"] != base["merging[1]"]
    other = {task.label: task.key for task in tiny.tasks(tiny.job(source=number_source(content="other")))}
    assert not set(base.values()) & set(other.values())


def test_luigi_tells_tasks_of_different_keys_or_sequences_apart(tiny, number_source):
    jobs = [tiny.job(), tiny.job(PipelineConfig(seed=1)), tiny.job(source=number_source(name="other"))]
    assert len({task.task_id for job in jobs for task in tiny.tasks(job)}) == 12
    assert len({task.task_id for job in (tiny.job(), tiny.job()) for task in tiny.tasks(job)}) == 4


def test_candidates_draw_different_numbers_and_a_task_always_the_same(tiny, tmp_path):
    _, middle_0, middle_1, _ = tiny.finish(tiny.job())
    assert not np.array_equal(middle_0.read().values, middle_1.read().values)
    other = type(tiny)(tmp_path / "elsewhere", [])
    first, _, other_1, _ = other.tasks(other.job())
    first.run()
    other_1.run()  # before candidate 0
    assert np.array_equal(other_1.read().values, middle_1.read().values)


def test_a_run_is_reported_from_start_to_finish_with_few_words_about_progress(tiny):
    first, *_ = tiny.tasks(tiny.job())
    first.run()
    assert kinds(tiny) == [("started", "ingest"), ("warning", "ingest"), ("progress", "ingest"), ("finished", "ingest")]
    assert tiny.events[1].message == "three points were dropped"
    assert tiny.events[2].energy == 1.0
    assert tiny.events[-1].seconds > 0


def test_the_log_holds_what_the_stage_printed_and_logged(tiny, capfd):
    first, *_ = tiny.tasks(tiny.job())
    first.run()
    log = first.place.log.read_text()
    assert "a word on standard output" in log
    assert "three points were dropped" in log
    assert capfd.readouterr().out == ""


def test_a_failure_is_recorded_logged_and_reported_until_a_success(tiny, number_source):
    job = tiny.job(source=number_source(refuses="load"))
    first, *_ = tiny.tasks(job)
    with pytest.raises(InputError):
        first.run()
    failure = Failure.model_validate_json(first.place.failure.read_bytes())
    assert (failure.error, failure.message, failure.bad_input) == ("InputError", "frame.ply: found nothing", True)
    assert "Traceback" in (first.place.failure.parent / failure.log).read_text()
    assert tiny.events[-1].kind == "failed"
    assert tiny.events[-1].bad_input
    assert not first.complete()
    again, *_ = tiny.tasks(tiny.job())
    assert again.place.failure == first.place.failure
    again.run()
    assert not again.place.failure.exists()


def test_a_corrupt_input_is_named_and_not_used(tiny):
    first, middle, *_ = tiny.tasks(tiny.job())
    first.run()
    chunk = first.directory / "arrays.zarr" / "values" / "c" / "0"
    chunk.write_bytes(chunk.read_bytes()[:-1] + b"x")
    with pytest.raises(artifacts.CorruptArtifactError):
        middle.run()
    failure = Failure.model_validate_json(middle.place.failure.read_bytes())
    assert str(first.directory) in failure.message
    assert not failure.bad_input
    assert not middle.complete()


def test_a_rerun_replaces_a_stage_and_what_follows_and_keeps_the_old_until_then(tiny):
    before = {task: artifacts.completed_at(task.directory) for task in tiny.finish(tiny.job())}
    job = tiny.job()
    affected = downstream_of("merging", [tiny.tasks(job)[-1]])
    assert [task.label for task in affected] == ["merging[0]", "merging[1]", "final_fit"]
    job.replaces.update({task.directory: artifacts.completed_at(task.directory) for task in affected})
    first, *_, last = tiny.tasks(job)
    assert first.complete()
    assert not any(task.complete() for task in affected)
    assert all(task.complete() for task in tiny.tasks(tiny.job()))  # to any other run nothing is missing
    old = last.read().values
    tiny.finish(job)
    after = {task: artifacts.completed_at(task.directory) for task in tiny.tasks(tiny.job())}
    assert {task.label for task in before if before[task] != after[task]} == {"merging[0]", "merging[1]", "final_fit"}
    assert np.array_equal(last.read().values, old)
    assert all(task.complete() for task in affected)


def test_upstream_first_names_each_task_once_after_what_it_needs(tiny):
    tasks = tiny.tasks(tiny.job())
    ordered = upstream_first([tasks[-1], tasks[0]])
    assert sorted(task.label for task in ordered) == ["final_fit", "ingest", "merging[0]", "merging[1]"]
    for task in ordered:
        assert all(ordered.index(needed) < ordered.index(task) for needed in task.requires().values())


@pytest.mark.parametrize("obstacle", ["log", "failure", "folder"])
def test_whatever_stands_in_the_way_of_a_task_is_told(tiny, obstacle):
    first, *_ = tiny.tasks(tiny.job())
    if obstacle == "folder":
        tiny.workdir.joinpath("scans").mkdir(parents=True)
        first.job.folder.write_text("a file")
    else:
        getattr(first.place, obstacle).mkdir(parents=True)
    with pytest.raises(OSError, match=str(first.job.folder)):
        first.run()
    assert kinds(tiny)[-1] == ("failed", "ingest")
    assert str(first.job.folder) in tiny.events[-1].message
    assert not tiny.events[-1].bad_input


def test_a_full_disk_is_the_reason_that_is_told(tiny, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device", "somewhere")

    monkeypatch.setattr(artifacts, "pack", full)
    first, *_ = tiny.tasks(tiny.job())
    with pytest.raises(OSError, match="somewhere"):
        first.run()
    assert tiny.events[-1].message.startswith("somewhere: No space left on device; free some space")
