"""Tables of points as text: .xyz, .txt, .csv, .pts, .asc and the like, from any program.

Spaces, tabs, commas or semicolons separate the columns. Lines before the first row of numbers are a header. If it names
x, y and z, these columns are read, else the first three. A line before the rows with a single whole number is their
count. Colours are read where the header names them, and in .xyzrgb and .pts, whose columns are known.
"""

from __future__ import annotations

import codecs
import itertools
import logging
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO

import numpy as np

from stages.ingest.formats.cloud import Cloud, as_colours, colour_columns
from stages.ingest.formats.numbers import LONGEST_LINE, checked_line, fields, number, numbers
from stages.ingest.formats.rows import declared_count
from stages.ingest.messages import check_count

_log = logging.getLogger("rearticulate.ingest")

_MARKS = (  # longer ones first, since shorter ones are their beginnings
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_DELIMITERS = (";", "\t", ",", None)
_LONGEST_HEADER = 1000  # in lines
_SAMPLE = 50  # rows from which the layout is determined
_COMMENT = re.compile(r"(^|[\s,;])(#|//|%).*")  # except the # in 1.#QNAN
_OFF = re.compile(r"(ST)?C?N?4?OFF", re.IGNORECASE)
_LISTS = re.compile(r"\s*[\[(]\s*([\[(][^\[\](),]*(,[^\[\](),]*){2,}[\])]\s*,?\s*){5}")  # as in one line of JSON
_WHOLE = re.compile("[0-9]{1,12}")
_FEWEST_VERTICES = 5
_BEFORE_NAMES = "#/% \t"
_AFTER_NAME = re.compile(r"\s*[\[(].*[\])]$|[ _](m|cm|mm)$")  # a unit
_POSITION = r"(?:points?|pos|position|coords?|coordinates?|vert|vertex|vertices|field|p|xyz)[ _.:\[-]*"
_AXES = (
    re.compile(r"[xyz]"),
    re.compile(rf"(?:{_POSITION})?([xyz])\]?(?:[ _.-]*(?:coord|coordinate|pos|position)s?)?"),
    re.compile(rf"{_POSITION}([012])\]?"),
    re.compile(r"[012]"),  # as pandas writes a plain array with its index
)


@dataclass(frozen=True)
class _Layout:
    """The position of the coordinates, and of the colours if there are any, in a line."""

    delimiter: str | None
    width: int
    columns: list[int] = field(default_factory=lambda: [0, 1, 2])
    colours: list[int] = field(default_factory=list)


def read_table(path: Path, most: int) -> Cloud:
    """Read the points of a table. Raises ValueError or OSError, also for more than `most` points."""
    with _open_text(path) as file:
        header, lines = _split(_lines(file))
        first = next(lines, None)
        if first is None:
            if words := _words(header):
                bars = "; put commas in place of the |" if "|" in words[-1] else ""
                raise ValueError(f"found no row of three numbers, but {words[0][:60]!r}{bars}")
            return Cloud(numbers([], [0, 1, 2], None, 3))
        sample = [first, *itertools.islice(lines, _SAMPLE)]
        if _counts_columns(sample):
            header.append(sample.pop(0))
        vertices = _Vertices(sample, header)
        layout = _layout(sample[0], header, path)
        _check_commas(sample, layout)
        counts = _Counts(header, most)
        rows = counts.rows(vertices.rows(itertools.chain(sample, lines)))
        if not layout.colours:
            layout = replace(layout, colours=_usual_colours(path.suffix.lower(), sample, layout))
        table = numbers(rows, layout.columns + layout.colours, layout.delimiter, layout.width)
        table = vertices.checked(table, layout)
    counts.check(len(table))
    return Cloud(np.ascontiguousarray(table[:, :3]), as_colours(table[:, 3:]) if layout.colours else None)


def _usual_colours(suffix: str, sample: list[str], layout: _Layout) -> list[int]:
    """The columns of colours in the formats that have them without a header: .xyzrgb, and .pts with its intensity."""
    width = layout.width
    if suffix == ".xyzrgb" and width >= 6:
        return [3, 4, 5]
    if suffix != ".pts" or width not in (6, 7) or layout.columns != [0, 1, 2]:
        return []
    values = [number(word, layout.delimiter) for line in sample for word in fields(line, layout.delimiter)[-3:]]
    return [width - 3, width - 2, width - 1] if all(value in range(256) for value in values) else []


def looks_like_table(path: Path) -> bool:
    """Whether a file begins like a table of points. Raises OSError if it cannot be read."""
    try:
        with _open_text(path) as file:
            return next(_split(_lines(file))[1], None) is not None
    except ValueError:
        return False


def _words(header: list[str]) -> list[str]:
    """The lines of a header except counts."""
    return [line for line in header if not line.isdigit()]


class _Counts:
    """The counts of rows that a .pts file writes before each block, compared with the rows found."""

    def __init__(self, header: list[str], most: int) -> None:
        self.declared = [declared_count(line) for line in header if line.isdigit()]
        self.most = most

    def rows(self, lines: Iterable[str]) -> Iterator[str]:
        """Yield the lines without the counts of further blocks. Raises beyond the most rows."""
        found = 0
        for line in lines:
            if self.declared and line.isdigit():
                self.declared.append(declared_count(line))
                continue
            found += 1
            check_count(found, self.most)
            yield line

    def check(self, found: int) -> None:
        """Raise ValueError unless the last count, or the sum of all, equals the number of rows."""
        if self.declared and found not in (self.declared[-1], sum(self.declared)):
            raise ValueError(f"found {found} of the {sum(self.declared)} points that it declares")


class _Vertices:
    """The row of whole numbers that OFF writes before its vertices: the numbers of vertices, faces and edges.

    It is removed from `sample`, and the word OFF from `header`, if they begin with them. Without the word, the row
    only counts as such if that many rows follow.
    """

    def __init__(self, sample: list[str], header: list[str]) -> None:
        self.sure = bool(header) and _OFF.fullmatch(header[0]) is not None
        words = sample[0].split()
        self.first: list[int] = []
        whole = len(sample) > 1 and len(words) == 3 and all(map(_WHOLE.fullmatch, words))
        if whole and (self.sure or ("." in sample[1] and int(words[0]) >= _FEWEST_VERTICES)):
            self.first = [int(word) for word in words]
            del sample[0], header[: int(self.sure)]

    def rows(self, lines: Iterable[str]) -> Iterable[str]:
        """Yield the lines of the vertices."""
        return itertools.islice(lines, self.first[0]) if self.sure and self.first else lines

    def checked(self, table: np.ndarray, layout: _Layout) -> np.ndarray:
        """Return the rows. Include the first one if it turned out to be a point."""
        if not self.first or len(table) == self.first[0]:
            return table
        if self.sure:
            raise ValueError(f"found {len(table)} of the {self.first[0]} points that it declares")
        if layout.width != len(self.first):
            raise ValueError(f"the number of columns changed from {len(self.first)} to {layout.width} at row 1")
        return np.vstack([[float(self.first[column]) for column in layout.columns], table])


def _open_text(path: Path) -> IO[str]:
    with path.open("rb") as file:
        head = file.read(4096)
    encoding = next((name for mark, name in _MARKS if head.startswith(mark)), "")
    if not encoding and b"\0" in head:
        raise ValueError("found NUL bytes, expected text; it is a binary file, or UTF-16 without its mark")
    return path.open("r", encoding=encoding or "utf-8", errors="replace")


def _lines(file: IO[str]) -> Iterator[str]:
    """Yield the lines that are not empty, without surrounding white space."""
    while line := file.readline(LONGEST_LINE):
        if _LISTS.match(line):
            raise ValueError("found all points in one line, expected a line for each; write each one in a line")
        stripped = checked_line(line).strip()
        if stripped.startswith(("[", "(")):  # lists of lists
            stripped = stripped.strip("[](), ")
        if stripped:
            yield stripped


def _split(lines: Iterator[str]) -> tuple[list[str], Iterator[str]]:
    """Split lines into the header, with comments, and the rows, without comments."""
    header: list[str] = []
    for line in lines:
        bare = _without_comment(line)
        if bare and _is_row(bare):
            rest = (bare for line in lines if (bare := _without_comment(line)))
            return header, itertools.chain([bare], rest)
        header.append(line)
        if len(header) > _LONGEST_HEADER:
            break
    return header, iter(())


def _without_comment(line: str) -> str:
    if "#" in line or "/" in line or "%" in line:
        return _COMMENT.sub("", line).strip()
    return line


def _is_row(line: str) -> bool:
    """Whether a line is a row of numbers rather than a count: it has three of them, or fewer and nothing else."""
    if line.isdigit():
        return False
    return _delimiter(line) is not False or (len(line.split()) == 2 and all(map(_is_number, line.split(), [None] * 2)))


def _delimiter(line: str) -> str | bool | None:
    """The delimiter of a row's fields: one that gives only numbers, or at least three; else False."""
    found: str | bool | None = False
    for delimiter in _DELIMITERS:
        words = _without_empty_end(fields(line, delimiter))
        count = sum(bool(word.strip()) and _is_number(word, delimiter) for word in words)
        if count >= 3 and count == len(words):
            return delimiter
        if count >= 3 and found is False:
            found = delimiter
    return found


def _without_empty_end(words: list[str]) -> list[str]:
    return words if words[-1].strip() else words[:-1]


def _is_number(word: str, delimiter: str | None) -> bool:
    try:
        number(word, delimiter)
    except ValueError:
        return False
    return True


def _layout(first: str, header: list[str], path: Path) -> _Layout:
    """Determine the layout from the first row and the header. Raises ValueError if they contradict each other."""
    delimiter = _delimiter(first)
    if isinstance(delimiter, bool):
        raise ValueError(f"found {len(first.split())} columns, expected x, y and z, in the row {first[:40]!r}")
    words = fields(first, delimiter)
    width = len(_without_empty_end(words))
    for line in reversed(header):
        comment = line.startswith(("#", "%"))
        for names in (line.strip(_BEFORE_NAMES).split(delimiter), re.split(r"[,;\s]+", line.strip(_BEFORE_NAMES))):
            columns = _columns(names, width)
            if columns is None or (comment and columns != [0, 1, 2] and len(names) != width):
                continue
            shift = _shift(names, columns, words, width, delimiter)
            shifted = [[column + shift for column in found] for found in (columns, colour_columns(names))]
            return _Layout(delimiter, len(words), *shifted)
    if names := [line for line in _words(header) if not line.startswith(("#", "%"))]:
        _log.warning("%s: found no x, y and z in the header %r, so took the first columns", path.name, names[-1][:60])
    return _Layout(delimiter, len(words))


def _columns(names: list[str], width: int) -> list[int] | None:
    """The columns that a header names x, y and z, or None. Raises ValueError if it names only some of them."""
    plain = [_AFTER_NAME.sub("", name.strip(" \t\"'").lower()) for name in names]
    for pattern in _AXES:
        axes = [match[match.lastindex or 0] if (match := pattern.fullmatch(name)) else "" for name in plain]
        for wanted in ("xyz", "012"):
            if all(axis in axes for axis in wanted):
                if pattern is _AXES[0] and any(axes.count(axis) > 1 for axis in wanted):
                    raise ValueError(f"found a column named twice in the header {' '.join(names)[:60]!r}")
                return [axes.index(axis) for axis in wanted]
    if len(names) == width and (found := [name for name in plain if name in ("x", "y", "z")]):
        missing = [axis for axis in "xyz" if axis not in found]
        raise ValueError(f"found no {' or '.join(missing)} among the columns {', '.join(names)[:60]}")
    return None


def _shift(names: list[str], columns: list[int], words: list[str], width: int, delimiter: str | None) -> int:
    """The number of unnamed columns before those that the header names."""
    named = len(_without_empty_end(names))
    if width == named + 1 and (words[0].strip().startswith('"') or _is_index(words)):
        return 1  # a column of row names, as R writes it
    if width != named and (columns != [0, 1, 2] or (delimiter == "," and width == 2 * named)):
        reason = "; decimal commas need semicolons or tabs between the columns" if width == 2 * named else ""
        raise ValueError(f"found {width} values in the first row, but {named} names in the header{reason}")
    return 0


def _is_index(words: list[str]) -> bool:
    return words[0].strip() in ("0", "1") and all("." in word for word in words[1:4])


def _counts_columns(sample: list[str]) -> bool:
    """Whether the first row is a header 0, 1, 2, ..., as pandas writes it for an array, with or without its index."""
    words = [word for word in re.split(r"[,;\s]+", sample[0]) if word]
    return len(sample) > 1 and "." in sample[1] and words == [str(index) for index in range(len(words))]


def _check_commas(sample: list[str], layout: _Layout) -> None:
    """Raise ValueError if commas both separate numbers and occur in them, as in 0,5,-0,25,1,0."""
    if layout.delimiter != "," or layout.width % 2 or layout.width < 6 or any("." in line for line in sample):
        return
    if any(re.search(r"(^|,)\s*-0\s*,|,0[0-9]+\s*(,|$)", line) for line in sample):
        raise ValueError("found commas between the columns and in the numbers, expected semicolons between the columns")
