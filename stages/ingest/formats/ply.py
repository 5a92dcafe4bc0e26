"""PLY, as text or binary, with any columns and elements besides the vertices' coordinates.

It is parsed here rather than by Open3D, since a reader of scans must detect damaged files. Open3D 0.20 returns
uninitialised memory for a truncated binary PLY and garbage for one without z, with at most a warning on the console.
It also rejects infinite coordinates in text.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int64

from stages.ingest.formats.cloud import Cloud, as_colours
from stages.ingest.formats.rows import (
    Column,
    Rows,
    declared_count,
    end_of,
    from_binary,
    from_text,
    lists_from_binary,
    lists_from_text,
    split_header,
    text_lines,
)
from stages.ingest.messages import check_count

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


_CORNERS = ("vertex_indices", "vertex_index")


def read_ply(path: Path, most: int) -> Cloud:
    """Read the vertices and their colours. Raises ValueError or OSError, also for more than `most`."""
    layout = _layout(path)
    if "vertex" not in layout.elements:
        raise ValueError("found no element vertex")
    vertices = layout.elements["vertex"]
    xyz, rgb = vertices.xyz(), vertices.rgb()
    if layout.byte_order is None:
        with path.open("rb") as file:
            lines = itertools.islice(text_lines(file, layout.start), layout.rows_before("vertex"), None)
            columns = list(from_text(vertices, xyz + rgb, lines, most).T)
    else:
        start = layout.start_of("vertex", path)
        columns = from_binary(vertices, xyz + rgb, path, start, layout.byte_order, most)
    points = np.stack(columns[:3], axis=1).astype(np.float64)
    if not rgb:
        return Cloud(points)
    kind = np.result_type(*(vertices.columns[index].dtype for index in rgb))
    return Cloud(points, as_colours(np.stack(columns[3:], axis=1).astype(kind)))


def ply_triangles(path: Path, vertices: int, most: int) -> Int64[np.ndarray, "triangles 3"]:
    """Read the faces, polygons as fans of triangles; none for a file without faces.

    Raises ValueError or OSError for damaged faces, for more than `most`, and for faces of other than the `vertices`.
    """
    layout = _layout(path)
    faces = layout.elements.get("face", Rows([], 0))
    columns = [index for index, column in enumerate(faces.columns) if column.length and column.name in _CORNERS]
    if not columns or not faces.count:
        return np.zeros((0, 3), dtype=np.int64)
    check_count(faces.count, most)
    if layout.byte_order is None:
        with path.open("rb") as file:
            lines = itertools.islice(text_lines(file, layout.start), layout.rows_before("face"), None)
            polygons = lists_from_text(faces, columns[0], lines)
    else:
        start = layout.start_of("face", path)
        polygons = lists_from_binary(faces, columns[0], path, start, layout.byte_order)
    triangles = np.concatenate([np.zeros((0, 3), dtype=np.int64), *map(_fans, polygons)])
    check_count(len(triangles), most)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < vertices:
        raise ValueError(f"found a face of vertices {triangles.min()} to {triangles.max()}, there are {vertices}")
    return triangles


def _fans(polygons: Int64[np.ndarray, "polygons corners"]) -> Int64[np.ndarray, "triangles 3"]:
    """Cut polygons of one size into triangles about their first corners."""
    corners = polygons.shape[1]
    fans = [polygons[:, [0, corner, corner + 1]] for corner in range(1, corners - 1)]
    return np.concatenate(fans) if fans else np.zeros((0, 3), dtype=np.int64)


@dataclass(frozen=True)
class _Layout:
    """What a header declares: the elements, where they begin, and the byte order, which is None for text."""

    elements: dict[str, Rows]
    start: int
    byte_order: str | None

    def before(self, name: str) -> list[Rows]:
        """The elements before one."""
        return [self.elements[other] for other in list(self.elements)[: list(self.elements).index(name)]]

    def rows_before(self, name: str) -> int:
        return sum(rows.count for rows in self.before(name))

    def start_of(self, name: str, path: Path) -> int:
        """The position of an element's first byte in a binary file."""
        start = self.start
        for rows in self.before(name):
            start = end_of(rows, path, start, self.byte_order or "")
        return start


def _layout(path: Path) -> _Layout:
    with path.open("rb") as file:
        header, start = split_header(file, "end_header", "PLY")
    if [word.lower() for word in header[0]] != ["ply"]:
        raise ValueError("found no PLY header")
    encoding = next((words[1] for words in header if words[0] == "format" and len(words) == 3), "none")
    elements = _elements(header)
    if encoding != "ascii" and encoding not in _BYTE_ORDERS:
        raise ValueError(f"found format {encoding}, expected ascii, {' or '.join(_BYTE_ORDERS)}")
    return _Layout(elements, start, _BYTE_ORDERS.get(encoding))


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
