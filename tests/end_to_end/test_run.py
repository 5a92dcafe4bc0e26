"""`reart run`, `status`, `inspect` and `rerun` on a tiny data set."""

import json
import shutil

import pytest

RUN = ("run", "--dataset", "scans", "--data", "data")
STATUS = ("status", "--dataset", "scans", "--data", "data")
STAGES = [
    "ingest",
    "alignment",
    "flow",
    "relaxed_fit",
    "projection",
    "merging",
    "final_fit",
    "canonical_frame",
    "assessment",
    "result",
    "export",
    "evaluation",
    "report",
]


def stage(name):
    return name.split("/")[1].split("-")[0]


def artifact(place, name):
    return next(path for path in (place.workdir / "scans" / "box").glob(f"{name}-*") if path.is_dir())


def test_a_sound_sequence_is_finished_though_another_is_bad_input(finished):
    assert finished.outcome.returncode == 2
    done = finished.manifests()
    assert {name.split("/")[0] for name in done} == {"box"}
    assert {stage(name) for name in done} == set(STAGES)
    [error] = finished.outcome.stderr.splitlines()
    assert error.startswith("error: flat ingest: data/flat/frame_1.npy")
    assert ".log)" in error


def test_a_run_ends_with_the_metrics_of_what_was_finished(finished):
    table = finished.outcome.stdout.split("sequence")[-1]
    assert "box" in table
    assert "flat" not in table
    metrics = next(manifest["payload"] for name, manifest in finished.manifests().items() if "evaluation" in name)
    assert f"{metrics['parts_found']}/2" in table
    assert f"{metrics['ari']:.3f}" in table


def test_a_run_leaves_the_evaluation_that_evaluate_makes_of_it(finished, copy):
    written = json.loads((finished.workdir / "scans" / "evaluation" / "evaluation.json").read_text())
    assert [score["sequence"] for score in written["sequences"]] == ["box"]
    assert [entry["sequence"] for entry in written["missing"]] == ["flat"]
    copied = finished.workdir / "scans" / "evaluation" / "sequences"
    assert (copied / "box.png").read_bytes().startswith(b"\x89PNG")
    assert (copied / "box.html").read_bytes() == (artifact(finished, "report") / "report.html").read_bytes()
    outcome = copy.reart("evaluate", "--dataset", "scans", "--data", "data", "--json")
    assert outcome.returncode == 1
    assert outcome.stderr.startswith("flat failed: ingest: data/flat/frame_1.npy")
    again = json.loads(outcome.stdout)
    assert again | {"created": None} == written | {"created": None}


def test_nothing_is_left_over_but_artifacts_logs_failures_and_the_evaluation(finished):
    assert finished.hidden() == []
    for path in (finished.workdir / "scans").glob("*/*"):
        known = (path / "manifest.json").exists() or path.suffix == ".log" or path.name.endswith(".failed.json")
        assert known or path.parent.name == "evaluation"


def test_status_tells_done_and_failed_and_why(finished):
    tasks = json.loads(finished.reart(*STATUS, "--json").stdout)
    states = {(task["sequence"], task["task"]): task for task in tasks}
    assert {task["state"] for task in tasks if task["sequence"] == "box"} == {"done"}
    assert states["flat", "ingest"]["state"] == "failed"
    assert "frame_1.npy" in states["flat", "ingest"]["message"]
    assert states["flat", "flow"]["state"] == "missing"
    table = finished.reart(*STATUS).stdout
    assert "failed" in table
    assert "frame_1.npy" in table


def test_a_final_fit_setting_reruns_only_the_final_fit_and_what_follows(copy):
    before = copy.times()
    outcome = copy.reart(*RUN, "--sequences", "box", "--set", "final_fit.reach=1.5")
    assert outcome.returncode == 0
    after = copy.times()
    assert before.items() <= after.items()  # side by side
    assert sorted(stage(name) for name in after.keys() - before.keys()) == [
        "assessment",
        "canonical_frame",
        "evaluation",
        "export",
        "final_fit",
        "report",
        "result",
    ]
    tasks = json.loads(copy.reart(*STATUS, "--json").stdout)
    assert {task["state"] for task in tasks if task["sequence"] == "box"} == {"done"}


def test_a_rerun_computes_a_stage_and_all_after_it_anew(copy):
    before, contents = copy.times(), copy.contents()
    outcome = copy.reart("rerun", "final_fit", "--dataset", "scans", "--data", "data", "--sequence", "box")
    assert outcome.returncode == 0
    after = copy.times()
    anew = {stage(name) for name in before if before[name] != after[name]}
    assert anew == {"final_fit", "canonical_frame", "assessment", "result", "export", "evaluation", "report"}
    assert copy.contents() == contents
    assert copy.hidden() == []


def test_a_flipped_byte_upstream_is_reported_and_not_used(copy):
    shutil.rmtree(artifact(copy, "result"))
    final = artifact(copy, "canonical_frame")
    chunk = final / "arrays.zarr" / "model" / "axis" / "c" / "0" / "0"
    data = bytearray(chunk.read_bytes())
    data[len(data) // 2] ^= 1
    chunk.write_bytes(data)
    outcome = copy.reart(*RUN, "--sequences", "box")
    assert outcome.returncode == 1
    [error] = outcome.stderr.splitlines()
    assert error.startswith("error: box result:")
    assert final.name in error
    inspected = copy.reart("inspect", final)
    assert inspected.returncode == 1
    assert "corrupt: arrays.zarr/model/axis" in inspected.stdout


def test_a_deleted_artifact_is_made_again_though_what_follows_is_complete(copy):
    contents = copy.contents()
    shutil.rmtree(artifact(copy, "ingest"))
    assert copy.reart(*RUN, "--sequences", "box").returncode == 0
    assert copy.contents() == contents


def test_inspect_shows_arrays_and_energies(finished):
    final = artifact(finished, "final_fit")
    shown = finished.reart("inspect", final)
    assert shown.returncode == 0
    for word in ("Ts_frame_canonical", "float64", "3 frames", "E_recons", "merging"):
        assert word in shown.stdout
    report = json.loads(finished.reart("inspect", final, "--json").stdout)
    assert report["problems"] == []
    assert report["manifest"]["config"]["final_fit"]["iterations"] == 4
    assert report["energies"]["E_recons"] > 0


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ((*RUN, "--sequences", "box,lmap"), "lmap"),
        (("rerun", "fit", "--dataset", "scans", "--data", "data", "--sequence", "box"), "'fit'"),
        (("run", "--dataset", "scans", "--data", "nowhere"), "nowhere"),
    ],
)
def test_a_request_that_cannot_be_met_is_one_line_and_exit_code_2(finished, words, complaint):
    outcome = finished.reart(*words)
    assert outcome.returncode == 2
    [error] = outcome.stderr.splitlines()
    assert error.startswith("error: ")
    assert complaint in error


def test_a_damaged_evaluation_or_result_is_named_and_its_page_stays(copy):
    page = copy.workdir / "scans" / "evaluation" / "sequences" / "box.html"
    (artifact(copy, "evaluation") / "manifest.json").write_text("{")
    (artifact(copy, "result") / "model.json").unlink()
    outcome = copy.reart(*RUN, "--sequences", "box")
    assert outcome.returncode == 1
    assert [word in outcome.stderr for word in ("evaluation-", "model.json: missing")] == [True, True]
    assert len(outcome.stderr.splitlines()) == 2
    assert page.exists()
    checked = copy.reart(*STATUS, "--check", "--json")
    assert checked.returncode == 1
    states = {task["task"]: task["state"] for task in json.loads(checked.stdout) if task["sequence"] == "box"}
    assert {name for name, state in states.items() if state == "corrupt"} == {"result", "evaluation"}


def test_an_artifact_that_cannot_be_looked_into_fails_its_sequence_only(copy):
    shutil.copytree(copy.folder / "data" / "box", copy.folder / "data" / "crate")
    result = artifact(copy, "result")
    shutil.rmtree(result)
    result.symlink_to(result.name)
    outcome = copy.reart(*RUN, "--sequences", "box,crate")
    assert outcome.returncode == 1
    [error] = outcome.stderr.splitlines()
    assert "Too many levels of symbolic links" in error
    assert "crate" in outcome.stdout.split("sequence")[-1]
    assert "Traceback" not in copy.reart(*STATUS).stderr


def test_every_failure_is_told_though_one_of_them_cannot_be_looked_into(copy):
    folder = copy.workdir / "scans" / "box"
    shutil.rmtree(folder)
    folder.symlink_to(folder.name)
    outcome = copy.reart(*RUN)
    assert outcome.returncode == 1
    errors = outcome.stderr.splitlines()
    assert [error.split()[1] for error in errors] == ["box", "flat"]
    assert "Too many levels of symbolic links" in errors[0]


def test_an_input_that_goes_while_the_rest_is_computed_is_evaluated_all_the_same(fresh):
    (fresh.folder / "mine.py").write_text(
        "import shutil\nfrom stages.flow.geometric import estimate_geometric as flow\n"
        "def hungry(*args):\n    shutil.rmtree('data', ignore_errors=True)\n    return flow(*args)\n"
    )
    outcome = fresh.reart(*RUN, "--sequences", "box", "--set", "flow.estimator=mine:hungry")
    assert (outcome.returncode, outcome.stderr) == (0, "")
    assert "1 of 1 sequences evaluated" in (fresh.workdir / "scans" / "evaluation" / "evaluation.md").read_text()
