import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

from pipeline.results.comparison import compare
from pipeline.results.evaluation_files import default_folder, write_evaluation
from pipeline.results.scores import gather
from pipeline.run.tasks import EvaluationTask, ReportTask
from pipeline.store import artifacts
from schemas.errors import InputError
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


def test_the_json_is_the_whole_evaluation(written):
    scores, out = written
    assert Scores.model_validate_json((out / "evaluation.json").read_bytes()) == scores
    assert "| bolt | 3/4 |" in (out / "evaluation.md").read_text()
    assert (out / "evaluation.csv").read_text().startswith("level,name,")


def test_the_page_is_well_formed_and_names_nothing_but_files_that_were_written(written):
    _, out = written
    page = (out / "index.html").read_text()
    addresses = Addresses(page)
    assert addresses.open == []
    for address in addresses.found:
        assert (out / unquote(address)).is_file(), address
    assert not re.search(r"https?:|//|url\(|@import", page)


def test_rows_and_pictures_link_to_copies_of_the_reports_so_that_the_folder_can_be_moved(written):
    _, out = written
    addresses = Addresses((out / "index.html").read_text()).found
    assert {f"sequences/{name}" for name in ("bolt.html", "bolt.png", "ur5.html", "ur5.png")} == set(addresses)
    assert (out / "sequences" / "bolt.html").read_text() == "<p>bolt"


def test_only_what_an_earlier_evaluation_wrote_is_removed(evaluated, written):
    scores, out = written
    write_evaluation(scores, evaluated.workdir, out, compare(scores, scores, "old.json"))
    assert json.loads((out / "comparison.json").read_text())["before"] == "old.json"
    assert "Compared with old.json" in (out / "index.html").read_text()
    (out / "sequences" / "mine.png").write_text("")
    write_evaluation(gather(evaluated.request("ur5")), evaluated.workdir, out)
    assert {path.name for path in (out / "sequences").iterdir()} == {"mine.png", "ur5.html", "ur5.png"}
    assert not (out / "comparison.json").exists()


@pytest.mark.parametrize("content", ["{", "[]", "[" * 200_000, '{"sequences": [{}]}'])
def test_an_earlier_evaluation_that_cannot_be_read_is_overwritten(evaluated, written, content):
    scores, out = written
    (out / "evaluation.json").write_text(content)
    write_evaluation(scores, evaluated.workdir, out)
    assert Scores.model_validate_json((out / "evaluation.json").read_bytes()) == scores


@pytest.mark.parametrize(
    "damage",
    [
        shutil.rmtree,
        lambda path: (path / artifacts.MANIFEST).write_text("{"),
        lambda path: (path / "report.html").write_text("changed"),
    ],
)
def test_figures_stand_without_a_report_that_is_gone_or_corrupt(evaluated, written, damage):
    scores, out = written
    damage(ReportTask(job=evaluated.job("bolt")).directory)
    write_evaluation(scores, evaluated.workdir, out)
    assert {path.name for path in (out / "sequences").iterdir()} == {"ur5.html", "ur5.png"}
    page = (out / "index.html").read_text()
    assert "0.900" in page
    assert "bolt.html" not in page


def test_what_is_not_evaluated_is_on_the_page_and_nothing_is_taken_for_markup(written):
    scores, out = written
    missing = MissingScore(sequence="a1", state="failed", message="<script>alert(1)</script>")
    write_evaluation(scores.model_copy(update={"missing": (missing,)}), Path(), out)
    page = (out / "index.html").read_text()
    assert "2 of 3 sequences evaluated" in page
    assert "&lt;script&gt;" in page
    assert "<script" not in page


@pytest.mark.parametrize("name", ["{victim}", "../../victim", "..", "", 3, None])
def test_an_earlier_evaluation_names_no_file_outside_the_folder(evaluated, written, tmp_path, name):
    scores, out = written
    for ending in (".html", ".png"):
        (tmp_path / f"victim{ending}").write_text("mine")
        (out.parent / f"victim{ending}").write_text("mine")
    planted = {"sequences": [{"sequence": name and str(name).format(victim=tmp_path / "victim")}]}
    (out / "evaluation.json").write_text(json.dumps(planted))
    write_evaluation(scores, evaluated.workdir, out)
    assert all((folder / f"victim{e}").exists() for folder in (tmp_path, out.parent) for e in (".html", ".png"))


def test_pages_are_neither_written_nor_removed_through_a_link(evaluated, written, tmp_path):
    _, out = written
    (out / "sequences").rename(tmp_path / "elsewhere")
    (out / "sequences").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere" / "ur5.html").write_text("mine")
    with pytest.raises(InputError, match="symbolic link"):
        write_evaluation(gather(evaluated.request("ur5")), evaluated.workdir, out)
    assert (tmp_path / "elsewhere" / "bolt.html").exists()
    assert (tmp_path / "elsewhere" / "ur5.html").read_text() == "mine"


def test_a_sequence_whose_evaluation_is_damaged_keeps_its_page_until_it_is_gone(evaluated, written):
    _, out = written
    (EvaluationTask(job=evaluated.job("bolt")).directory / artifacts.MANIFEST).write_text("{")
    for _ in range(2):  # the second time it was missing before, too
        write_evaluation(gather(evaluated.request()), evaluated.workdir, out)
        assert (out / "sequences" / "bolt.html").exists()
    write_evaluation(gather(evaluated.request("ur5")), evaluated.workdir, out)
    assert not (out / "sequences" / "bolt.html").exists()
