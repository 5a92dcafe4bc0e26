import contextlib
import os
import subprocess
import sys

import pytest


@pytest.mark.parametrize("model_path", ["chain", "chain/model.json"])
def test_a_model_is_drawn(reart, model, tmp_path, model_path):
    done = reart("figure", model_path, "--out", "pictures/chain.png")
    assert (done.exit_code, done.stdout) == (0, "written: pictures/chain.png\n")
    assert (tmp_path / "pictures" / "chain.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("nowhere", "--out", "a.png"), "nowhere/model.json: not found"),
        (("chain", "--out", "a.jpg"), "--out a.jpg: found .jpg, expected .png, .svg, .pdf"),
        (("chain", "--out", "folder.png"), "--out folder.png: found a folder, expected a picture"),
        (("chain", "--out", f"{'a' * 300}.png"), "found a name too long"),
        (("chain", "--out", "chain/model.npz/a.png"), "--out chain/model.npz: found a file"),
    ],
)
def test_what_cannot_be_drawn_is_one_line_and_exit_code_2(reart, model, tmp_path, words, complaint):
    (tmp_path / "folder.png").mkdir()
    result = reart("figure", *words)
    assert result.exit_code == 2
    [error] = result.stderr.splitlines()
    assert complaint in error


def test_what_the_user_set_of_matplotlib_neither_stops_nor_changes_a_picture(reart, model, tmp_path):
    reart("figure", "chain", "--out", "expected.png")
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nlines.linewidth: 30\n")
    subprocess.run(
        [sys.executable, "-c", "from pipeline.cli import app; app()", "figure", "chain", "--out", "found.png"],
        cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "nonsense"},
        check=True,
    )
    assert (tmp_path / "found.png").read_bytes() == (tmp_path / "expected.png").read_bytes()


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_a_picture_is_written_whole_or_not_at_all_and_a_link_is_not_followed(reart, model, tmp_path, monkeypatch, kind):
    precious = tmp_path / "precious"
    precious.write_text("precious")
    out = tmp_path / f"chain.{kind}"
    out.symlink_to(precious)

    def full(path, content):
        raise OSError(28, os.strerror(28), str(path))

    with monkeypatch.context() as patch:
        patch.setattr(sys.modules["pipeline.cli.figure"], "write_atomically", full)
        with contextlib.suppress(OSError):
            reart("figure", "chain", "--out", out)
    assert out.is_symlink()
    assert reart("figure", "chain", "--out", out).exit_code == 0
    assert not out.is_symlink()
    assert precious.read_text() == "precious"
