"""PLY, as text or binary, with any columns and elements besides the vertices' coordinates.

It is parsed here rather than by Open3D, since a reader of scans must detect damaged files. Open3D 0.20 returns
uninitialised memory for a truncated binary PLY and garbage for one without z, with at most a warning on the console.
It also rejects infinite coordinates in text.
"""

from __future__ import annotations

import itertools
from pathlib import Path

from stages.ingest.formats.rows import (
    Column,
    Points,
    Rows,
    declared_count,
    end_of,
    from_binary,
    from_text,
    split_header,
    text_lines,
)

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


def read_ply(path: Path, most: int) -> Points:
    """Read the coordinates of the vertices. Raises ValueError or OSError, also for more than `most`."""
    with path.open("rb") as file:
        header, start = split_header(file, "end_header", "PLY")
        if [word.lower() for word in header[0]] != ["ply"]:
            raise ValueError("found no PLY header")
        encoding = next((words[1] for words in header if words[0] == "format" and len(words) == 3), "none")
        elements = _elements(header)
        if "vertex" not in elements:
            raise ValueError("found no element vertex")
        before = [elements[name] for name in list(elements)[: list(elements).index("vertex")]]
        vertices = elements["vertex"]
        if encoding == "ascii":
            skipped = sum(rows.count for rows in before)
            return from_text(vertices, itertools.islice(text_lines(file, start), skipped, None), most)
    if encoding not in _BYTE_ORDERS:
        raise ValueError(f"found format {encoding}, expected ascii, {' or '.join(_BYTE_ORDERS)}")
    for rows in before:
        start = end_of(rows, path, start, _BYTE_ORDERS[encoding])
    return from_binary(vertices, path, start, _BYTE_ORDERS[encoding], most)


def _elements(header: list[list[str]]) -> dict[str, Rows]:
    elements: dict[str, Rows] = {}
    for words in header:
        match words:
            case ["element", name, count]:
                current = name.lower()
                if current in elements:
                    raise ValueError(f"found the element {name} twice, expected it once")
                elements[current] = Rows([], declared_count(count))
            case ["property", "list", length, kind, name] if elements and length in _TYPES and kind in _TYPES:
                elements[current].columns.append(Column(name, _TYPES[kind], length=_TYPES[length]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[current].columns.append(Column(name, _TYPES[kind]))
            case ["element" | "property", *_]:
                raise ValueError(f"found an unknown header line {' '.join(words)[:100]!r}")
    return elements
