import json

import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.results.scores import gather
from pipeline.run.tasks import EvaluationTask
from schemas.errors import InputError


@pytest.fixture
def evaluate(evaluated, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")

    def run(*words):
        command = ["evaluate", "--dataset", "roboart", "--workdir", evaluated.workdir, *words]
        return CliRunner().invoke(app, [str(word) for word in command], catch_exceptions=False)

    return run


def test_where_everything_is_there_the_exit_code_is_0_and_tables_and_files_are_made(evaluate, evaluated):
    result = evaluate("--sequences", "bolt,ur5")
    assert result.exit_code == 0
    assert "mean (2)" in result.stdout
    assert result.stderr == ""
    assert (evaluated.workdir / "roboart" / "evaluation" / "index.html").is_file()


def test_what_is_missing_is_named_and_the_exit_code_is_1(evaluate, evaluated):
    evaluation = EvaluationTask(job=evaluated.job("a1"))
    evaluation.fail(InputError("it broke"))
    result = evaluate("--sequences", "a1,bolt")
    assert result.exit_code == 1
    assert "bolt" in result.stdout
    assert result.stderr.splitlines() == [f"a1 failed: evaluation: it broke (log: {evaluation.place.log})"]


def test_what_this_machine_lacks_is_named_but_fails_only_where_it_was_asked_for(evaluate, evaluated):
    evaluated.lacked.update(("panda", "cassie", "nao", "spot"))
    result = evaluate("--split", "validation")
    assert result.exit_code == 0
    assert result.stderr.count("unavailable") == 4
    assert evaluate("--sequences", "nao").exit_code == 1


def test_json_is_the_evaluation_or_else_the_comparison(evaluate, evaluated, tmp_path):
    names, out = ("--sequences", "bolt,ur5"), tmp_path / "out"
    printed = json.loads(evaluate(*names, "--json", "--out", out).stdout)
    assert printed == json.loads((out / "evaluation.json").read_text())
    compared = json.loads(evaluate(*names, "--json", "--out", out, "--against", out / "evaluation.json").stdout)
    assert compared["mean"]["differences"]["ari"]["verdict"] == "same"


def test_a_comparison_names_settings_and_sequences_that_differ(evaluate, evaluated, tmp_path):
    earlier = gather(evaluated.request("bolt"))
    earlier = earlier.model_copy(update={"config": earlier.config | {"seed": 7}})
    (tmp_path / "old.json").write_text(earlier.model_dump_json())
    shown = evaluate("--sequences", "bolt,ur5", "--against", tmp_path / "old.json").stdout
    assert "settings that differ: seed: 7 -> 0" in shown
    assert "only now: ur5" in shown
