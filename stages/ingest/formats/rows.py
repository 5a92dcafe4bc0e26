"""Rows of columns that the headers of PLY and PCD declare, from binary data or text."""

from __future__ import annotations

import itertools
import math
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from jaxtyping import Float64, Int64

from stages.ingest.formats.cloud import colour_columns
from stages.ingest.formats.numbers import LONGEST_LINE, checked_line, numbers
from stages.ingest.messages import check_count

_LONGEST_HEADER = 1 << 20
_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
_UTF8_MARK = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class Column:
    """One column: one value, `values` of them, or a list whose length has the type `length`."""

    name: str
    dtype: str
    values: int = 1
    length: str | None = None


@dataclass(frozen=True)
class Rows:
    """The rows that a header declares: their number and their columns."""

    columns: list[Column]
    count: int

    def xyz(self) -> list[int]:
        """The columns of x, y and z, in small letters or capitals. Raises ValueError if they are unclear."""
        names = [column.name for column in self.columns]
        lowered = [name.lower() for name in names]
        if missing := [name for name in "xyz" if name not in lowered]:
            raise ValueError(f"found no {' or '.join(missing)} among the columns {', '.join(names)}")
        if twice := [name for name in names if name != "_" and names.count(name) > 1]:  # PCD names padding _
            raise ValueError(f"found the column {twice[0]} twice, expected it once")
        wanted = [names.index(name) if name in names else lowered.index(name) for name in "xyz"]
        for column in (self.columns[index] for index in wanted):
            if column.length or column.values != 1:
                raise ValueError(f"found several values of {column.name} for a point, expected one")
        return wanted

    def rgb(self) -> list[int]:
        """The columns of red, green and blue; empty if there are none."""
        found = colour_columns([column.name for column in self.columns])
        plain = all(self.columns[index].length is None and self.columns[index].values == 1 for index in found)
        return found if plain else []

    def has_lists(self) -> bool:
        """Whether the size of a row depends on its content."""
        return any(column.length for column in self.columns)


def split_header(file: IO[bytes], end: str, kind: str) -> tuple[list[list[str]], int]:
    """Split the header, up to the line that `end` matches, into words by line. Also return the end's position."""
    data = file.read(_LONGEST_HEADER)
    if data.startswith(_UTF16_MARKS):
        raise ValueError("found UTF-16 text, expected plain text (UTF-8)")
    match = re.search(rb"^" + end.encode() + rb"[ \t]*\r?\n", data, re.MULTILINE)
    if match is None and b"\r" in data and b"\n" not in data[: data.index(b"\r") + 2]:
        raise ValueError("found lines that end with CR alone; convert them to LF (mac2unix)")
    if match is None:
        raise ValueError(f"found no complete {kind} header")
    lines = data[: match.end()].removeprefix(_UTF8_MARK).decode("latin1").splitlines()
    return [words for words in map(str.split, lines) if words], match.end()


def declared_count(text: str) -> int:
    """Parse a number of rows in a header. Raises ValueError for anything else."""
    if not re.fullmatch(r"[0-9]{1,12}", text):
        raise ValueError(f"found a count of {text[:20]!r}, expected a number")
    return int(text)


def from_binary(
    rows: Rows, wanted: list[int], path: Path, start: int, byte_order: str, most: int
) -> list[np.ndarray[Any, Any]]:
    """Read columns, each in its own type, of rows that begin at byte `start`. Nothing else of the file is kept."""
    check_count(rows.count, most)
    if rows.count == 0:
        return [np.empty(0, rows.columns[index].dtype) for index in wanted]
    data = np.memmap(path, np.uint8, mode="r")
    lengths = _equal_lengths(rows, data, start, byte_order)
    if lengths is None:
        return list(_walk(rows, data, start, byte_order, wanted)[0].T)
    record = _record(rows, byte_order, lengths)
    if len(data) - start < rows.count * record.itemsize:
        found = max(len(data) - start, 0) // record.itemsize
        raise ValueError(f"found {found} of the {rows.count} points that it declares")
    table = np.frombuffer(data, record, rows.count, start)
    return [table[str(index)][:, 0] for index in wanted]


def end_of(rows: Rows, path: Path, start: int, byte_order: str) -> int:
    """The position of the byte after rows that begin at byte `start`. It may be beyond the file's end."""
    if rows.count == 0:
        return start
    data = np.memmap(path, np.uint8, mode="r")
    lengths = _equal_lengths(rows, data, start, byte_order)
    if lengths is None:
        return _walk(rows, data, start, byte_order, [])[1]
    return start + rows.count * _record(rows, byte_order, lengths).itemsize


def lists_from_binary(
    rows: Rows, wanted: int, path: Path, start: int, byte_order: str
) -> list[Int64[np.ndarray, "lists length"]]:
    """Read a column of lists of whole numbers, sorted into one array for each length."""
    if rows.count == 0:
        return []
    data = np.memmap(path, np.uint8, mode="r")
    lengths = _equal_lengths(rows, data, start, byte_order)
    if lengths is not None:
        table = np.frombuffer(data, _record(rows, byte_order, lengths), rows.count, start)
        return [table[str(wanted)].astype(np.int64)]
    by_length: dict[int, list[tuple[int, int]]] = {}
    offset = start
    for row in range(rows.count):
        for index, column in enumerate(rows.columns):
            values = column.values
            if column.length:
                length, offset = _value(data.data, offset, byte_order + column.length)
                values = _checked_length(length)
            if index == wanted:
                by_length.setdefault(values, []).append((row, offset))
            offset += np.dtype(column.dtype).itemsize * values
            if offset > len(data):
                raise ValueError(f"found {row} of the {rows.count} rows that it declares")
    dtype = np.dtype(byte_order + rows.columns[wanted].dtype)
    return [_gathered(data, [at for _, at in places], length, dtype) for length, places in by_length.items()]


def _gathered(data: np.memmap[Any, Any], places: list[int], length: int, dtype: np.dtype[Any]) -> np.ndarray:
    """The lists of one length that begin at these bytes."""
    bytes_of = np.array(places, dtype=np.int64)[:, None] + np.arange(length * dtype.itemsize)
    return np.asarray(data)[bytes_of].view(dtype).astype(np.int64)


def lists_from_text(rows: Rows, wanted: int, lines: Iterator[str]) -> list[Int64[np.ndarray, "lists length"]]:
    """Read such a column from rows of text. The first of `lines` is the first row."""
    by_length: dict[int, list[list[str]]] = {}
    count = 0
    for line in itertools.islice(lines, rows.count):
        entry = _entries(rows, line)[wanted]
        by_length.setdefault(len(entry), []).append(entry)
        count += 1
    if count < rows.count:
        raise ValueError(f"found {count} of the {rows.count} rows that it declares")
    return [np.array(lists, dtype=np.float64).astype(np.int64) for lists in by_length.values()]


def from_text(rows: Rows, wanted: list[int], lines: Iterator[str], most: int) -> Float64[np.ndarray, "rows columns"]:
    """Read columns of rows of text. The first of `lines` is the first row."""
    check_count(rows.count, most)
    counted = _Counted(itertools.islice(lines, rows.count))
    try:
        table = _text_columns(rows, iter(counted), wanted)
    except ValueError:
        counted.to_the_end()
        if counted.count == rows.count:
            raise
    if counted.count < rows.count:  # also the likely cause of an odd last line
        raise ValueError(f"found {counted.count} of the {rows.count} points that it declares")
    return table


class _Counted:
    """An iterator of lines that counts them."""

    def __init__(self, lines: Iterator[str]) -> None:
        self._lines = lines
        self.count = 0

    def __iter__(self) -> Iterator[str]:
        for line in self._lines:
            self.count += 1
            yield line

    def to_the_end(self) -> None:
        for _ in self:
            pass


def _text_columns(rows: Rows, lines: Iterator[str], wanted: list[int]) -> Float64[np.ndarray, "rows columns"]:
    if rows.has_lists():
        return np.array([_without_lists(rows, line, wanted) for line in lines]).reshape(-1, len(wanted))
    starts = np.cumsum([0] + [column.values for column in rows.columns])
    return numbers(lines, [int(starts[index]) for index in wanted], None, int(starts[-1]))


def text_lines(file: IO[bytes], start: int) -> Iterator[str]:
    """Yield the lines of a file from byte `start` on, without empty ones."""
    file.seek(start)
    while line := checked_line(file.readline(LONGEST_LINE)):
        if not line.isspace():
            yield line.decode("latin1")


def _record(rows: Rows, byte_order: str, lengths: dict[int, int]) -> np.dtype[Any]:
    """One row as a numpy type, with lists of the given lengths."""
    fields: list[tuple[str, str, tuple[int]]] = []
    for index, column in enumerate(rows.columns):
        if column.length:
            fields.append((f"length {index}", byte_order + column.length, (1,)))
        fields.append((str(index), byte_order + column.dtype, (lengths.get(index, column.values),)))
    return np.dtype(fields)


def _equal_lengths(rows: Rows, data: np.memmap[Any, Any], start: int, byte_order: str) -> dict[int, int] | None:
    """The length of each list column if it is the same in all rows, else None."""
    if not rows.has_lists():
        return {}
    lengths: dict[int, int] = {}
    offset = start
    for index, column in enumerate(rows.columns):
        if column.length:
            length, offset = _value(data, offset, byte_order + column.length)
            lengths[index] = _checked_length(length)
        offset += np.dtype(column.dtype).itemsize * lengths.get(index, column.values)
    record = _record(rows, byte_order, lengths)
    if len(data) - start < rows.count * record.itemsize:
        return None
    table = np.frombuffer(data, record, rows.count, start)
    same = all((table[f"length {index}"] == length).all() for index, length in lengths.items())
    return lengths if same else None


def _walk(
    rows: Rows, data: np.memmap[Any, Any], start: int, byte_order: str, wanted: list[int]
) -> tuple[Float64[np.ndarray, "rows columns"], int]:
    """Read the wanted columns row by row, with lists of any length. Also return the rows' end."""
    table = np.empty((rows.count if wanted else 0, len(wanted)))
    sizes = [np.dtype(column.dtype).itemsize for column in rows.columns]
    view, offset = data.data, start
    for row in range(rows.count):
        for index, column in enumerate(rows.columns):
            if index in wanted:
                table[row, wanted.index(index)], _ = _value(view, offset, byte_order + column.dtype)
            values = column.values
            if column.length:
                length, offset = _value(view, offset, byte_order + column.length)
                values = _checked_length(length)
            offset += sizes[index] * values
    if offset > len(data):
        raise ValueError("found fewer rows than it declares")
    return table, offset


def _value(data: Any, offset: int, dtype: str) -> tuple[float, int]:
    """Read one number. Also return the position of the next one."""
    code = dtype[0] + np.dtype(dtype).char
    if offset + struct.calcsize(code) > len(data):
        raise ValueError("found fewer rows than it declares")
    return struct.unpack_from(code, data, offset)[0], offset + struct.calcsize(code)


def _checked_length(length: float) -> int:
    if not math.isfinite(length) or length != int(length) or length < 0:
        raise ValueError(f"found a list of {length} values")
    return int(length)


def _without_lists(rows: Rows, line: str, wanted: list[int]) -> list[float]:
    """The wanted columns of one line, which are no lists."""
    entries = _entries(rows, line)
    return [float(entries[index][0]) for index in wanted]


def _entries(rows: Rows, line: str) -> list[list[str]]:
    """The words of each column of one line, whose lists begin with their length."""
    words, found, place = line.split(), [], 0
    for column in rows.columns:
        if place >= len(words):
            raise ValueError(f"found a line of {len(words)} values, fewer than it declares")
        count = _checked_length(float(words[place])) if column.length else column.values
        place += bool(column.length)
        found.append(words[place : place + count])
        place += count
    if place != len(words):
        raise ValueError(f"found {len(words)} values a line, expected the {place} that it declares")
    return found
