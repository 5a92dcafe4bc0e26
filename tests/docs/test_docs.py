"""The documents name what there is: files, links, stages, data sets and kinds of joints."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.configuration.presets import DATASETS
from pipeline.run.tasks import STAGES
from schemas.joints import JOINT_KINDS

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
EXAMPLES = ("mobility", "pendulum", "NAME")  # of the recipes
PATH = re.compile(r"`((?:pipeline|stages|schemas|tests|tools|docs|benchmarks)/[\w./-]+)`")


def anchors(text):
    """The anchors of a document's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document):
    text = document.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if link.startswith("http"):
            continue
        path, _, anchor = link.partition("#")
        target = document.parent / path if path else document
        assert target.exists(), link
        assert not anchor or anchor in anchors(target.read_text(encoding="utf-8")), link


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_files_that_are_named_are_there(document):
    for path in PATH.findall(document.read_text(encoding="utf-8")):
        assert (ROOT / path).exists() or any(example in path for example in EXAMPLES), path


def test_all_stages_data_sets_and_kinds_of_joints_are_described():
    readme, architecture, inputs = (
        (ROOT / path).read_text(encoding="utf-8") for path in ("README.md", "docs/architecture.md", "docs/inputs.md")
    )
    for stage in STAGES:
        assert f"| `{stage}` |" in readme
        assert f"| `{stage}` |" in architecture
    for kind in JOINT_KINDS:
        assert f"| `{kind}` |" in architecture
    for dataset in DATASETS:
        assert f"`{dataset}`" in inputs


def test_the_picture_of_the_stages_is_what_its_script_draws():
    drawn = subprocess.run(
        [sys.executable, "-c", "from draw_data_flow import STAGES, picture; print(*STAGES); print(picture(), end='')"],
        cwd=ROOT / "tools",
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    names, _, picture = drawn.partition("\n")
    assert set(names.split()) == set(STAGES)
    assert (ROOT / "docs" / "data_flow.svg").read_text(encoding="utf-8") == picture
