import sys

import pytest

from pipeline.configuration.presets import load_config
from pipeline.run.plugins import _resolve, own_code, own_weights
from schemas.errors import InputError


class Answers(list):
    """Stands in for the pipe that the child answers through."""

    send = list.append


@pytest.fixture
def ask(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text("def solve():\n    pass\n\nnumber = 3\n")
    monkeypatch.syspath_prepend(tmp_path)

    def answer(setting):
        answers = Answers()
        _resolve(load_config([], [setting]), answers)
        [problem] = answers
        return problem

    return answer


def test_our_own_and_the_users_functions_are_found(ask):
    assert ask("flow.estimator=geometric") is None
    assert ask("relaxed_fit.solver=mine:solve") is None


@pytest.mark.parametrize(
    "text", ["def solve(:", "raise RuntimeError('two\\nlines')", "raise SystemExit(3)", "import no_such_module"]
)
def test_whatever_goes_wrong_in_the_users_module_is_told_by_its_setting(ask, tmp_path, text):
    (tmp_path / "broken.py").write_text(text)
    sys.modules.pop("broken", None)
    assert ask("flow.estimator=broken:solve").startswith("flow.estimator: cannot import 'broken:solve' (")


@pytest.mark.parametrize("name", ["geometrik", "mine:nothing", "nowhere:solve", "mine:number"])
def test_what_cannot_be_used_is_told_by_its_setting(ask, name):
    for setting in ("flow.estimator", "relaxed_fit.solver"):
        problem = ask(f"{setting}={name}")
        assert problem.startswith(f"{setting}: ")
        assert name in problem


def test_weights_that_are_none_are_told_before_anything_runs(ask, tmp_path):
    path = tmp_path / "weights.safetensors"
    assert "found no such file" in ask(f"flow.network.weights={path}")
    path.write_bytes(b"\x80\x04N.")  # a pickle
    assert "found something else than safetensors" in ask(f"flow.network.weights={path}")


def test_the_digest_of_weights_follows_the_file(tmp_path):
    path = tmp_path / "weights.safetensors"
    assert own_weights(None) == own_weights(path) == {}
    path.write_bytes(b"one")
    before = own_weights(path)
    path.write_bytes(b"two")
    assert list(before) == list(own_weights(path)) == [str(path)]
    assert before != own_weights(path)


def test_the_digest_of_ones_own_code_follows_its_file_and_runs_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "package").mkdir()
    for name in ("package/__init__.py", "package/mine.py", "single.py"):
        (tmp_path / name).write_text("raise SystemError('imported')")
    before = [own_code(name) for name in ("package.mine:solve", "single:solve", "package:solve")]
    assert [list(digest) for digest in before] == [["package.mine:solve"], ["single:solve"], ["package:solve"]]
    (tmp_path / "package" / "mine.py").write_text("changed")
    after = [own_code(name) for name in ("package.mine:solve", "single:solve", "package:solve")]
    assert before[0] != after[0]
    assert before[1:] == after[1:]
    assert [own_code(name) for name in ("geometric", "nowhere:solve", "sys:path", "single.deeper:solve")] == [{}] * 4


def test_weights_that_cannot_be_read_are_refused_by_name(tmp_path, monkeypatch):
    path = tmp_path / "weights.safetensors"
    path.write_bytes(b"one")

    def refuse(*args):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.open", refuse)
    with pytest.raises(InputError, match=r"weights\.safetensors: cannot be read \(Permission denied\)"):
        own_weights(path)
