"""HTML pages: tables of the evaluation and the frame around them. A page loads nothing from other addresses."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from urllib.parse import quote

from pipeline.results.report_tables import Cell, Row, Table

STYLE = """
:root { color-scheme: light dark; --ink: #1d2328; --soft: #5d6870; --line: #d8dee3; --page: #fff; --band: #f3f6f8;
  --link: #0b5cad; --better: #14763c; --worse: #b3261e; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e8eb; --soft: #9aa6af; --line: #39434b; --page: #14181b;
  --band: #1d2328; --link: #7ab8f5; --better: #6fd195; --worse: #ff8a80; } }
body { margin: 0 auto; max-width: 1500px; padding: 1rem; background: var(--page); color: var(--ink);
  font: 15px/1.45 system-ui, sans-serif; }
h1 { font-size: 1.5rem; margin: 0.5rem 0; } h2 { font-size: 1.15rem; margin: 2rem 0 0.5rem; }
p { margin: 0.25rem 0; color: var(--soft); } a { color: var(--link); }
.wide { overflow-x: auto; width: fit-content; max-width: 100%; border: 1px solid var(--line); border-radius: 6px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 0.35rem 0.6rem; text-align: right; white-space: nowrap; border-bottom: 1px solid var(--line); }
.words th, .words td { text-align: left; } .words td { white-space: normal; overflow-wrap: anywhere; }
thead th { color: var(--soft); font-weight: 600; background: var(--band); }
tbody th, thead th:first-child { text-align: left; position: sticky; left: 0; background: var(--page);
  font-weight: 500; }
thead th:first-child, tr.mean th, tr.mean td { background: var(--band); }
tr.first td, tr.first th { border-top: 2px solid var(--line); } tbody tr:last-child > * { border-bottom: 0; }
.better { color: var(--better); } .worse { color: var(--worse); }
figure { margin: 1rem 0; } figcaption { color: var(--soft); }
img { width: 100%; min-width: 56rem; display: block; background: #fff; border-radius: 6px; }
"""


def page(title: str, body: str) -> str:
    """Wrap a body in a whole page."""
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{escape(title)}</title>\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def table_html(table: Table, reports: Mapping[str, str]) -> str:
    """Render a table under its title. A sequence's row links to its report if `reports` has the address."""
    heads = "".join(f'<th scope="col">{escape(column)}</th>' for column in table.columns)
    mark = ' class="words"' if table.words else ""
    rows, section = [], ""
    for row in table.rows:
        rows.append(_row(row, reports, begins=row.section != section))
        section = row.section
    return (
        f'<h2>{escape(table.title)}</h2>\n<div class="wide"><table{mark}>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n'
        f"{chr(10).join(rows)}\n</tbody>\n</table></div>"
    )


def address(folder: str, file: str) -> str:
    """The address of a file in a folder beside the page, escaped as an attribute's value."""
    return escape(f"{folder}/{quote(file)}")


def picture_html(source: str, what: str) -> str:
    """Show a picture that scrolls sideways on a narrow screen. `source` is escaped already, as by `address`."""
    return f'<div class="wide"><img src="{source}" alt="{escape(what)}" loading="lazy"></div>'


def _row(row: Row, reports: Mapping[str, str], begins: bool) -> str:
    name = escape(row.name)
    if row.sequence in reports:
        name = f'<a href="{reports[row.sequence]}">{name}</a>'
    classes = " ".join(name for name, holds in (("mean", row.section), ("first", begins)) if holds)
    mark = f' class="{classes}"' if classes else ""
    return f'<tr{mark}><th scope="row">{name}</th>{"".join(map(_cell, row.cells))}</tr>'


def _cell(cell: Cell) -> str:
    mark = f' class="{cell.tone}"' if cell.tone else ""
    return f"<td{mark}>{escape(cell.text)}</td>"
