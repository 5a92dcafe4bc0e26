import numpy as np
import pytest

from pipeline.configuration.presets import load_config
from pipeline.run.plan import plan
from pipeline.run.protocol import Request
from pipeline.run.task import upstream_first
from pipeline.run.tasks import STAGES, final_tasks
from schemas.errors import InputError, UnavailableError


@pytest.fixture
def data(tmp_path):
    for name in ("box", "lamp"):
        (tmp_path / name).mkdir()
        for t in range(3):
            np.save(tmp_path / name / f"frame_{t}.npy", np.random.default_rng(t).normal(size=(40, 3)))
    return tmp_path


def request(folder, settings=(), **changes):
    values = {
        "dataset": "scans",
        "workdir": folder / "workdir",
        "config": load_config(["scans"], settings),
        "data": folder,
    }
    return Request.model_validate(values | changes)


def labels(job):
    return {task.label: task.key for task in upstream_first(final_tasks(job))}


def test_every_sequence_is_a_job_and_every_stage_a_task(data):
    jobs = plan(request(data))
    assert [job.source.name for job in jobs] == ["box", "lamp"]
    tasks = labels(jobs[0])
    assert list(dict.fromkeys(label.split("[")[0] for label in tasks)) == list(STAGES)
    assert {"relaxed_fit[0]", "relaxed_fit[1]", "merging[1]"} <= tasks.keys()


def test_a_final_fit_setting_changes_only_the_keys_from_the_final_fit_on(data):
    before, after = (labels(plan(request(data, settings))[0]) for settings in ((), ["final_fit.reach=0.5"]))
    changed = {label for label in before if before[label] != after[label]}
    after_it = {"canonical_frame", "assessment", "result", "export", "evaluation", "report"}
    assert changed == {*(label for label in before if label.startswith("final_fit[")), *after_it}


def test_one_more_candidate_leaves_the_others_as_they_are(data):
    before, after = (
        labels(plan(request(data, [f"canonical_frame.candidates={count}", "canonical_frame.fits=9"]))[0])
        for count in (2, 3)
    )
    assert after.keys() - before.keys() == {"relaxed_fit[2]", "projection[2]", "merging[2]", "final_fit[2]"}
    assert before["merging[1]"] == after["merging[1]"]
    assert before["canonical_frame"] != after["canonical_frame"]


@pytest.mark.parametrize(("count", "every", "tried"), [(3, 1, 3), (6, 1, 6), (7, 1, 2), (10, 2, 5)])
def test_all_of_a_few_frames_are_tried_each_with_a_relaxed_fit_of_its_own(tmp_path, count, every, tried):
    for frame in range(count):
        np.save(tmp_path / f"{frame}.npy", np.random.default_rng(frame).uniform(size=(40, 3)))
    (job,) = plan(request(tmp_path, [f"ingest.every={every}"], frames=tmp_path))
    tasks = {task.label: task for task in upstream_first(final_tasks(job))}
    finals = [label for label in tasks if label.startswith("final_fit")]
    assert finals == [f"final_fit[{rank}]" for rank in range(tried)]
    own = ["flow" in tasks[f"relaxed_fit[{rank}]"].requires() for rank in range(tried)]
    assert own == ([True] * tried if tried > 2 else [True, False])


def test_named_canonical_frames_are_the_candidates(data):
    tasks = labels(plan(request(data, ["canonical_frame.frames=[2, 0]"]))[0])
    assert {label for label in tasks if label.startswith("merging")} == {"merging[2]", "merging[0]"}


def test_a_changed_frame_changes_every_key_of_its_sequence_only(data):
    before = [labels(job) for job in plan(request(data))]
    np.save(data / "box" / "frame_1.npy", np.ones((40, 3)))
    after = [labels(job) for job in plan(request(data))]
    assert not set(before[0].values()) & set(after[0].values())
    assert before[1] == after[1]


def test_chosen_sequences_come_in_the_order_asked_and_once(data):
    assert [job.source.name for job in plan(request(data, sequences=("lamp", "box", "lamp")))] == ["lamp", "box"]


def test_an_unknown_sequence_is_refused_with_the_known_ones(data):
    with pytest.raises(InputError, match=r"lmap.*box, lamp"):
        plan(request(data, sequences=("lmap",)))


def test_an_unknown_stage_is_refused_with_the_known_ones(data):
    with pytest.raises(InputError, match=r"'fit'.*final_fit"):
        plan(request(data, rerun="fit"))


def test_frames_and_truth_of_one_sequence_need_no_data_set(data):
    (data / "truth.npz").write_bytes(b"whatever")
    plain, with_truth = (
        plan(request(data, data=None, frames=data / "lamp", truth=truth)) for truth in (None, data / "truth.npz")
    )
    assert [job.source.name for job in plain] == ["lamp"]
    assert plain[0].source_digest != with_truth[0].source_digest


def test_an_input_that_cannot_be_read_is_reported_and_stops_no_other(data, monkeypatch):
    def unreadable(source):
        if source.name == "box":
            raise InputError("box: cannot be read")
        return "digest"

    monkeypatch.setattr("stages.ingest.file_source.FileSource.digest", unreadable)
    events = []
    assert [job.source.name for job in plan(request(data), events.append)] == ["lamp"]
    [event] = events
    assert (event.kind, event.sequence, event.bad_input) == ("failed", "box", True)


def test_what_this_machine_lacks_fails_only_where_it_was_asked_for(data, monkeypatch):
    def unavailable(source):
        raise UnavailableError(f"{source.name}: install its package")

    monkeypatch.setattr("stages.ingest.file_source.FileSource.digest", unavailable)
    events = []
    assert plan(request(data), events.append) == []
    assert {(event.kind, event.bad_input) for event in events} == {("warning", False)}
    plan(request(data, sequences=("box",)), events.append)
    assert (events[-1].kind, events[-1].bad_input) == ("failed", True)


def test_a_users_own_function_has_its_file_in_the_key(data, monkeypatch):
    monkeypatch.chdir(data)
    (data / "mine.py").write_text("def flow(): pass")
    settings = ["flow.estimator=mine:flow"]
    before = labels(plan(request(data, settings))[0])
    (data / "mine.py").write_text("def flow(): return 1")
    after = labels(plan(request(data, settings))[0])
    assert {label for label in before if before[label] == after[label]} == {"ingest", "alignment"}


def test_the_truth_may_be_the_folder_that_holds_it(data):
    np.savez(data / "ground_truth.npz", labels=np.zeros(120, dtype=int))
    in_folder, itself = (
        plan(request(data, frames=data / "lamp", truth=truth)) for truth in (data, data / "ground_truth.npz")
    )
    assert in_folder[0].source == itself[0].source


def test_candidates_beyond_those_that_are_fitted_are_carried_over_from_the_first(data):
    one, two = (
        {task.label: task.requires().keys() for task in upstream_first(final_tasks(plan(request(data, settings))[0]))}
        for settings in (["canonical_frame.candidates=3", f"canonical_frame.fits={fits}"] for fits in (1, 2))
    )
    with_flow = [[label for label in tasks if "flow" in tasks[label]] for tasks in (one, two)]
    finals = {f"final_fit[{candidate}]" for candidate in range(3)}
    assert [set(labels) - finals for labels in with_flow] == [{"relaxed_fit[0]"}, {"relaxed_fit[0]", "relaxed_fit[1]"}]
