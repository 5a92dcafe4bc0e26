import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

from pipeline import store
from pipeline.comparison import compare
from pipeline.evaluation_files import default_folder, write_evaluation
from pipeline.scores import gather
from pipeline.tasks import ResultTask
from schemas.scores import MissingScore, Scores


class Addresses(HTMLParser):
    """Every address that a page names, and how deep its elements are nested."""

    def __init__(self, text):
        super().__init__()
        self.found = []
        self.open = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.found += [value for name, value in attributes if name in ("href", "src")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture
def written(evaluated):
    scores = gather(evaluated.request())
    out = default_folder(evaluated.request())
    write_evaluation(scores, evaluated.workdir, out)
    return scores, out


def pictures(out):
    return sorted((out / "sequences").glob("*.png"))


def test_the_json_is_the_whole_evaluation(written):
    scores, out = written
    assert Scores.model_validate_json((out / "evaluation.json").read_bytes()) == scores
    assert "| bolt | 3/4 |" in (out / "evaluation.md").read_text()
    assert (out / "evaluation.csv").read_text().startswith("level,name,")


def test_pages_are_well_formed_and_name_nothing_but_files_that_were_written(written):
    _, out = written
    for file in out.rglob("*.html"):
        addresses = Addresses(file.read_text())
        assert addresses.open == []
        for address in addresses.found:
            assert (file.parent / unquote(address)).is_file(), address
        assert not re.search(r"https?:|//|url\(|@import", file.read_text())


def test_rows_link_to_the_pages_of_their_sequences_which_show_a_picture(written):
    _, out = written
    addresses = Addresses((out / "index.html").read_text()).found
    assert {"sequences/bolt.html", "sequences/ur5.html"} <= set(addresses)
    [shown] = [a for a in Addresses((out / "sequences" / "bolt.html").read_text()).found if a.endswith(".png")]
    assert (out / "sequences" / shown).read_bytes().startswith(b"\x89PNG")


def test_a_picture_is_drawn_once_until_its_model_changes(evaluated, written):
    scores, out = written
    before = {path: path.stat().st_mtime_ns for path in pictures(out)}
    assert len(before) == 2
    write_evaluation(scores, evaluated.workdir, out)
    assert {path: path.stat().st_mtime_ns for path in pictures(out)} == before


def test_only_what_an_earlier_evaluation_wrote_is_removed(evaluated, written):
    scores, out = written
    write_evaluation(scores, evaluated.workdir, out, compare(scores, scores, "old.json"))
    assert json.loads((out / "comparison.json").read_text())["before"] == "old.json"
    assert "Compared with old.json" in (out / "index.html").read_text()
    (out / "sequences" / "mine.png").write_text("")
    write_evaluation(gather(evaluated.request("ur5")), evaluated.workdir, out)
    assert {path.name.split("-")[0] for path in (out / "sequences").iterdir()} == {"mine.png", "ur5", "ur5.html"}
    assert not (out / "comparison.json").exists()


@pytest.mark.parametrize("damage", [shutil.rmtree, lambda path: (path / store.MANIFEST).write_text("{")])
def test_figures_stand_without_a_picture_where_the_model_is_gone_or_corrupt(evaluated, damage, tmp_path, caplog):
    damage(ResultTask(job=evaluated.job("bolt")).directory)
    out = tmp_path / "out"
    write_evaluation(gather(evaluated.request()), evaluated.workdir, out)
    assert [path.name.split("-")[0] for path in pictures(out)] == ["ur5"]
    assert "0.900" in (out / "sequences" / "bolt.html").read_text()


def test_what_is_not_evaluated_is_on_the_page_and_nothing_is_taken_for_markup(written):
    scores, out = written
    missing = MissingScore(sequence="a1", state="failed", message="<script>alert(1)</script>")
    write_evaluation(scores.model_copy(update={"missing": (missing,)}), Path(), out)
    page = (out / "index.html").read_text()
    assert "2 of 3 sequences evaluated" in page
    assert "&lt;script&gt;" in page
    assert "<script" not in page
