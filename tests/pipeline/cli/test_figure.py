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
