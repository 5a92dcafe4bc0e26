"""The files of an evaluation: JSON, Markdown, CSV, and a page with the report and picture of every sequence."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable
from html import escape
from pathlib import Path

from pipeline.results.pages import address, page, picture_html, table_html
from pipeline.results.report_tables import comparison_tables, full_tables, to_csv, to_markdown
from pipeline.run.logs import OUR_LOGGER
from pipeline.run.protocol import Request
from pipeline.store import artifacts
from pipeline.store.files import check_own_folder, read_whole, write_atomically
from schemas.names import is_name
from schemas.scores import Comparison, Scores, SequenceScore

PAGES = "sequences"
COPIED = (".html", ".png")


def default_folder(request: Request) -> Path:
    """The default folder of an evaluation. It holds no stages, so nobody takes it for a sequence's folder."""
    return request.workdir / request.dataset / "evaluation"


def write_evaluation(scores: Scores, workdir: Path, out: Path, comparison: Comparison | None = None) -> None:
    """Write the evaluation, and the comparison if given, to the folder `out`. Make the folder if needed.

    Reports are copied, so that the folder can be moved or sent. Copies that only an earlier evaluation needed are
    removed. Raises InputError if the folder of the copies is a link, and OSError if it cannot write.
    """
    check_own_folder(out / PAGES)
    (out / PAGES).mkdir(parents=True, exist_ok=True)
    earlier = _sequences_in(out / "evaluation.json")
    reported = [score.sequence for score in scores.sequences if copy_report(score, workdir, out / PAGES)]
    contents = {
        "evaluation.json": scores.model_dump_json(indent=1) + "\n",
        "evaluation.md": document(scores, comparison),
        "evaluation.csv": to_csv(scores),
        "index.html": index_page(scores, reported, comparison),
    }
    if comparison is not None:
        contents["comparison.json"] = comparison.model_dump_json(indent=1) + "\n"
    for name, content in contents.items():
        write_atomically(out / name, content.encode())
    if comparison is None:
        (out / "comparison.json").unlink(missing_ok=True)
    kept = {*reported, *(entry.sequence for entry in scores.missing)}  # a missing sequence may come back
    for sequence in earlier - kept:  # by name, since the folder may hold files of the user
        for ending in COPIED:
            (out / PAGES / f"{sequence}{ending}").unlink(missing_ok=True)


def copy_report(score: SequenceScore, workdir: Path, folder: Path) -> bool:
    """Copy a sequence's page and picture, and return whether that succeeded. Raises OSError if it cannot write.

    The evaluation is complete without them, so an unusable artifact only causes a warning.
    """
    if score.report is None:
        return False
    directory = workdir / score.report
    try:
        contents = artifacts.read_files(directory)
    except artifacts.ArtifactError as error:
        logging.getLogger(OUR_LOGGER).warning("%s: no report (%s)", score.sequence, error)
        return False
    for ending in COPIED:
        write_atomically(folder / f"{score.sequence}{ending}", contents[f"report{ending}"])
    return True


def document(scores: Scores, comparison: Comparison | None = None) -> str:
    """The evaluation in Markdown."""
    tables = (comparison_tables(comparison) if comparison else []) + full_tables(scores)
    return "\n".join([f"## {_title(scores)}\n", f"{_summary(scores)}\n", *map(to_markdown, tables)])


def index_page(scores: Scores, reported: Iterable[str], comparison: Comparison | None = None) -> str:
    """The page of all tables and pictures. Rows link to the reports of the sequences that have one."""
    tables = (comparison_tables(comparison) if comparison else []) + full_tables(scores)
    reports = {sequence: address(PAGES, f"{sequence}.html") for sequence in reported}
    body = [f"<h1>{escape(_title(scores))}</h1>", f"<p>{escape(_summary(scores))}</p>"]
    if comparison is not None:
        body.append(f"<p>Compared with {escape(comparison.before)}.</p>")
        body.append(f"<p>Settings that differ: {escape('; '.join(comparison.settings) or 'none')}</p>")
    body += [table_html(table, reports) for table in tables]
    if reports:
        body.append("<h2>Pictures</h2>")
    for sequence, report in reports.items():
        caption = f'<figcaption><a href="{report}">{escape(sequence)}</a></figcaption>'
        what = f"{sequence}: input, parts with joint axes, tree, flow and a posed frame; below it the truth"
        body.append(f"<figure>{caption}{picture_html(address(PAGES, f'{sequence}.png'), what)}</figure>")
    return page(_title(scores), "\n".join(body))


def _sequences_in(evaluation: Path) -> set[str]:
    """The sequences of an earlier evaluation; none if it cannot be read.

    The file is not trusted: entries that are paths rather than names are left out.
    """
    try:
        earlier = json.loads(read_whole(evaluation))
        entries = [*earlier["sequences"], *earlier.get("missing", ())]
        return {entry["sequence"] for entry in entries if is_name(entry["sequence"])}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return set()


def _title(scores: Scores) -> str:
    return f"{scores.dataset}{f', split {scores.split}' if scores.split else ''}: evaluation"


def _summary(scores: Scores) -> str:
    total = len(scores.sequences) + len(scores.missing)
    return f"{len(scores.sequences)} of {total} sequences evaluated, {scores.created:%Y-%m-%d %H:%M} UTC."
