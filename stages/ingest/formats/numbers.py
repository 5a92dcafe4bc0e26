"""Columns of numbers in text, in the notations of various programs and languages."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable
from typing import AnyStr

import numpy as np
from jaxtyping import Float64

LONGEST_LINE = 1 << 16
_AT_ONCE = 100_000  # lines parsed at a time
_NOT_A_NUMBER = re.compile(r"[+-]?nan(\(.*)?|[+-]?1[.,]#(qnan|snan|ind)\w*|n/?a|#n/a|null|none|", re.IGNORECASE)
_INFINITE = re.compile(r"([+-]?)1[.,]#inf\w*", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]*([eE][+-]?[0-9]+)?")
_FORTRAN = re.compile(r"[+-]?[0-9.]+[dD][+-]?[0-9]+")
_AROUND = " \t\r\n\"'[](){}"


def numbers(
    lines: Iterable[str], columns: list[int], delimiter: str | None, width: int
) -> Float64[np.ndarray, "rows columns"]:
    """Parse the given columns of lines of `width` columns. The `delimiter` None means any white space.

    Other columns may hold anything. Raises ValueError with the row (from 0) for a line of another width, and for text
    in the given columns.
    """
    blocks, first, lines = [], 0, iter(lines)
    while block := list(itertools.islice(lines, _AT_ONCE)):
        _check_widths(block, delimiter, width, first)
        try:
            blocks.append(np.loadtxt(block, usecols=columns, delimiter=delimiter, comments=None, ndmin=2))
        except ValueError:
            blocks.append(_one_by_one(block, columns, delimiter, first))
        first += len(block)
    return np.concatenate(blocks) if blocks else np.empty((0, len(columns)))


def checked_line(line: AnyStr) -> AnyStr:
    """Return a line from readline(LONGEST_LINE). Raises ValueError if the line is longer."""
    if len(line) >= LONGEST_LINE:
        raise ValueError(f"found a line of more than {LONGEST_LINE:,} characters")
    return line


def fields(line: str, delimiter: str | None) -> list[str]:
    """Split one line into fields."""
    return line.split(delimiter)


def number(text: str, delimiter: str | None) -> float:
    """Parse one field as a number, in all common notations of NaN, with decimal commas, and in quotes.

    Raises ValueError for anything else.
    """
    text = text.strip(_AROUND)
    try:
        return float(text)
    except ValueError:
        if _NOT_A_NUMBER.fullmatch(text):
            return np.nan
        if infinite := _INFINITE.fullmatch(text):
            return float(infinite[1] + "inf")
        if delimiter != "," and _DECIMAL_COMMA.fullmatch(text):
            return float(text.replace(",", "."))
        if _FORTRAN.fullmatch(text):
            return float(re.sub("[dD]", "e", text))
        raise


def _one_by_one(
    lines: list[str], columns: list[int], delimiter: str | None, first: int
) -> Float64[np.ndarray, "rows columns"]:
    table = np.empty((len(lines), len(columns)))
    for row, line in enumerate(lines):
        words = fields(line, delimiter)
        for place, column in enumerate(columns):
            try:
                table[row, place] = number(words[column], delimiter)
            except ValueError as error:
                raise ValueError(
                    f"found {words[column].strip()[:40]!r} where a number is to be, at row {first + row}, "
                    f"column {column + 1}"
                ) from error
    return table


def _check_widths(lines: list[str], delimiter: str | None, width: int, first: int) -> None:
    for row, line in enumerate(lines):
        found = len(fields(line, delimiter)) if delimiter is None else line.count(delimiter) + 1
        if found == width:
            continue
        if first + row == 0:
            raise ValueError(f"found {found} values a line, expected the {width} that it declares")
        raise ValueError(f"the number of columns changed from {width} to {found} at row {first + row}")
