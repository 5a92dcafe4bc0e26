"""What an evaluation leaves on the disk: JSON, Markdown, CSV, and pages with a picture of every sequence."""

from __future__ import annotations

import io
import logging
import re
from html import escape
from pathlib import Path

import numpy as np

from pipeline import store
from pipeline.files import write_atomically
from pipeline.keys import KEY_DIGITS, artifact_key
from pipeline.logs import OUR_LOGGER
from pipeline.pages import page, page_name, picture_html, table_html
from pipeline.protocol import Request
from pipeline.report_tables import (
    comparison_tables,
    full_tables,
    sequence_tables,
    to_csv,
    to_markdown,
)
from schemas.model_file import Result
from schemas.scores import Comparison, Scores, SequenceScore
from schemas.sequence import IngestedSequence

FIGURE_VERSION = 1  # raised whenever pictures look different: what was drawn before is then drawn anew
PAGES = "sequences"
PICTURE_NAME = re.compile(rf"(?P<sequence>.+)-[0-9a-f]{{{KEY_DIGITS}}}\.png")


def default_folder(request: Request) -> Path:
    """Where an evaluation goes if nobody says otherwise. No sequence's folder: it is not of stages."""
    return request.workdir / request.dataset / "evaluation"


def write_evaluation(scores: Scores, workdir: Path, out: Path, comparison: Comparison | None = None) -> None:
    """Write the evaluation, and the comparison where there is one, to the folder `out`, which is made.

    Only pictures that are not there yet are drawn. What only an earlier evaluation had is removed.
    """
    (out / PAGES).mkdir(parents=True, exist_ok=True)
    pictures = {score.sequence: picture(score, scores.dataset, workdir, out / PAGES) for score in scores.sequences}
    contents = {
        Path("evaluation.json"): scores.model_dump_json(indent=1) + "\n",
        Path("evaluation.md"): document(scores, comparison),
        Path("evaluation.csv"): to_csv(scores),
        Path("index.html"): index_page(scores, pictures, comparison),
    }
    if comparison is not None:
        contents[Path("comparison.json")] = comparison.model_dump_json(indent=1) + "\n"
    for score in scores.sequences:
        contents[Path(PAGES) / f"{score.sequence}.html"] = sequence_page(score, pictures[score.sequence])
    for name, content in contents.items():
        write_atomically(out / name, content.encode())
    _remove_old(out, pictures, comparison is not None)


def picture(score: SequenceScore, dataset: str, workdir: Path, folder: Path) -> str | None:
    """Draw a sequence's model beside its true parts, unless that was done before.

    The picture's name, or None where there is none: figures stand without it, so what is wrong is only a warning.
    """
    if score.result is None:
        return None
    try:
        directory = workdir / score.result
        upstream = store.read_manifest(directory).upstream
        key = artifact_key(stage="figure", version=FIGURE_VERSION, config={}, parameters={}, upstream=upstream, seed=0)
        name = f"{score.sequence}-{key}.png"
        if not (folder / name).exists():
            result = store.read(directory, Result)
            ingested = store.read(workdir / dataset / score.sequence / f"ingest-{upstream['ingest']}", IngestedSequence)
            write_atomically(folder / name, draw(result, ingested))
        return name
    except Exception as error:
        logging.getLogger(OUR_LOGGER).warning("%s: no picture (%s: %s)", score.sequence, type(error).__name__, error)
        return None


def draw(result: Result, ingested: IngestedSequence) -> bytes:
    """The picture as PNG."""
    from stages.figure import draw  # matplotlib takes a second to import

    labels_true = None
    if ingested.truth is not None:
        ends = np.cumsum(ingested.sequence.point_counts)[:-1]
        labels_true = np.split(ingested.truth.labels, ends)[result.model.canonical_frame]
    content = io.BytesIO()
    draw(result, labels_true).savefig(content, format="png", dpi=90)
    return content.getvalue()


def document(scores: Scores, comparison: Comparison | None = None) -> str:
    """The evaluation in Markdown."""
    tables = (comparison_tables(comparison) if comparison else []) + full_tables(scores)
    return "\n".join([f"## {_title(scores)}\n", f"{_summary(scores)}\n", *map(to_markdown, tables)])


def index_page(scores: Scores, pictures: dict[str, str | None], comparison: Comparison | None = None) -> str:
    """The page of all tables, whose rows link to the sequences' pages, and of all pictures."""
    tables = (comparison_tables(comparison) if comparison else []) + full_tables(scores)
    body = [f"<h1>{escape(_title(scores))}</h1>", f"<p>{escape(_summary(scores))}</p>"]
    if comparison is not None:
        body.append(f"<p>Compared with {escape(comparison.before)}.</p>")
        body.append(f"<p>Settings that differ: {escape('; '.join(comparison.settings) or 'none')}</p>")
    body += [table_html(table, pages=f"{PAGES}/") for table in tables]
    body.append("<h2>Pictures</h2>")
    for sequence, name in pictures.items():
        if name is not None:
            link = f'<a href="{PAGES}/{page_name(sequence)}">{escape(sequence)}</a>'
            body.append(f"<figure><figcaption>{link}</figcaption>{picture_html(f'{PAGES}/{name}', sequence)}</figure>")
    return page(_title(scores), "\n".join(body))


def sequence_page(score: SequenceScore, picture_name: str | None) -> str:
    """The page of one sequence: its picture, figures and joints."""
    origin = ", ".join(value for value in (score.robot, score.type, score.split) if value)
    body = [
        '<p><a href="../index.html">All sequences</a></p>',
        f"<h1>{escape(score.sequence)}</h1>",
        f"<p>{escape(origin)}</p>",
    ]
    if picture_name is not None:
        what = f"{score.sequence}: input, predicted parts and joint axes, true parts, posed model and tree"
        body.append(picture_html(picture_name, what))
    body += [table_html(table) for table in sequence_tables(score)]
    return page(score.sequence, "\n".join(body))


def _remove_old(out: Path, pictures: dict[str, str | None], compared: bool) -> None:
    """Remove what an earlier evaluation wrote, known by its name: the folder may hold files of the user's."""
    for path in (out / PAGES).iterdir():
        if (match := PICTURE_NAME.fullmatch(path.name)) and path.name not in pictures.values():
            path.unlink()
            if match["sequence"] not in pictures:
                (out / PAGES / f"{match['sequence']}.html").unlink(missing_ok=True)
    if not compared:
        (out / "comparison.json").unlink(missing_ok=True)


def _title(scores: Scores) -> str:
    return f"{scores.dataset}{f', split {scores.split}' if scores.split else ''}: evaluation"


def _summary(scores: Scores) -> str:
    total = len(scores.sequences) + len(scores.missing)
    return f"{len(scores.sequences)} of {total} sequences evaluated, {scores.created:%Y-%m-%d %H:%M} UTC."
