"""One file with points to an array of coordinates: PLY, PCD, XYZ and numpy's own.

PLY and PCD are read here rather than by Open3D, since a reader of scans must notice a damaged file. Open3D
0.20 returns uninitialised memory for a truncated binary PLY, garbage for one without z and zeros for bad
lines of a PCD, all with at most a warning on the console, and it rejects infinite coordinates in text.
Checking it takes parsing the header anyway, and after that the rows are one numpy call. It still unpacks
compressed PCD, whose size can be checked.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from schemas.errors import InputError

Points = Float64[np.ndarray, "points 3"]

_PLY_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_PLY_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


def one_line(error: Exception) -> str:
    """What an exception says, as one short line."""
    return " ".join(str(error).split())[:300].rstrip(".") or type(error).__name__


def read_points(path: Path) -> Points:
    """The coordinates that one .ply, .pcd, .xyz or .npy file holds, NaN and infinity included.

    Normals, colours, faces and other columns are ignored. Raises InputError for a file that is damaged,
    truncated or of another kind.
    """
    suffix = path.suffix.lower()
    try:
        return _READERS[suffix](path)
    except (ValueError, OverflowError, MemoryError, TypeError, OSError) as error:
        raise InputError(
            f"{path}: {one_line(error)}; export it again as a whole {suffix} file of points with x, y and z"
        ) from error


def as_points(array: Any) -> Points:
    """An array of one frame as float64 coordinates. Raises ValueError for anything but real (points, 3)."""
    if not isinstance(array, np.ndarray):
        raise ValueError(f"found a {type(array).__name__}, expected an array of shape (points, 3)")
    if array.dtype.kind not in "iuf":
        raise ValueError(f"found dtype {array.dtype}, expected real numbers")
    if array.ndim == 3 and array.shape[2] == 3:
        raise ValueError(f"found an array of shape {array.shape} among frames; give that file itself as the sequence")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"found an array of shape {array.shape}, expected (points, 3)")
    return array.astype(np.float64)


def map_array(path: Path) -> np.ndarray:
    """A .npy file as a read-only map: its header is checked against its size and nothing is loaded.

    Raises ValueError or OSError for a file that is not a whole array of plain numbers.
    """
    return np.lib.format.open_memmap(path, mode="r")


def _read_npy(path: Path) -> Points:
    return as_points(np.asarray(map_array(path)))


def _read_xyz(path: Path) -> Points:
    lines = [line for line in path.read_bytes().splitlines() if line.partition(b"#")[0].strip()]
    table = _text_table(lines)
    if table.shape[1] < 3:
        raise ValueError(f"found {table.shape[1]} columns, expected x, y and z")
    return table[:, :3]


@dataclass(frozen=True)
class _Column:
    name: str
    dtype: str
    values: int = 1


@dataclass(frozen=True)
class _Rows:
    """What a header declares: how many rows of which columns."""

    columns: list[_Column]
    count: int

    def record(self, byte_order: str) -> np.dtype[Any]:
        return np.dtype(
            [(str(index), byte_order + column.dtype, (column.values,)) for index, column in enumerate(self.columns)]
        )

    def xyz(self) -> list[int]:
        """Which columns hold the coordinates."""
        names = [column.name for column in self.columns]
        if missing := [name for name in "xyz" if name not in names]:
            raise ValueError(f"found no {' or '.join(missing)} among the columns {', '.join(names)}")
        return [names.index(name) for name in "xyz"]


def _from_binary(rows: _Rows, body: bytes, byte_order: str) -> Points:
    columns, record = rows.xyz(), rows.record(byte_order)
    if len(body) < rows.count * record.itemsize:
        raise ValueError(f"found {len(body) // record.itemsize} of the {rows.count} points that it declares")
    table = np.frombuffer(body, record, rows.count)
    return np.stack([table[str(index)][:, 0] for index in columns], axis=1).astype(np.float64)


def _from_text(rows: _Rows, lines: list[bytes]) -> Points:
    if len(lines) < rows.count:
        raise ValueError(f"found {len(lines)} of the {rows.count} points that it declares")
    table = _text_table(lines[: rows.count])
    starts = np.cumsum([0] + [column.values for column in rows.columns])
    if table.size and table.shape[1] != starts[-1]:
        raise ValueError(f"found {table.shape[1]} values a line, expected the {starts[-1]} that it declares")
    return table[:, starts[rows.xyz()]]


def _text_table(lines: list[bytes]) -> Float64[np.ndarray, "rows columns"]:
    if not lines:
        return np.empty((0, 3))
    try:
        return np.loadtxt(lines, ndmin=2)
    except ValueError as error:  # the rest of the message is advice to callers of loadtxt
        raise ValueError(str(error).partition(";")[0]) from error


def _text_lines(body: bytes) -> list[bytes]:
    return [line for line in body.splitlines() if line.strip()]


def _split_header(data: bytes, end: str, kind: str) -> tuple[list[list[str]], bytes]:
    """The words of each header line up to the one that `end` matches, and the bytes after it."""
    match = re.search(rb"^" + end.encode() + rb"[ \t]*\r?\n", data, re.MULTILINE)
    if match is None:
        raise ValueError(f"found no whole {kind} header")
    lines = data[: match.end()].decode("latin1").splitlines()
    return [words for words in map(str.split, lines) if words], data[match.end() :]


def _read_ply(path: Path) -> Points:
    header, body = _split_header(path.read_bytes(), "end_header", "PLY")
    if header[0] != ["ply"]:
        raise ValueError("found no PLY header")
    encoding = next((words[1] for words in header if words[0] == "format" and len(words) == 3), "none")
    elements = _ply_elements(header)
    if "vertex" not in elements:
        raise ValueError("found no element vertex")
    before = [elements[name] for name in list(elements)[: list(elements).index("vertex")]]
    vertices = elements["vertex"]
    if encoding == "ascii":
        return _from_text(vertices, _text_lines(body)[sum(rows.count for rows in before) :])
    if encoding not in _PLY_BYTE_ORDERS:
        raise ValueError(f"found format {encoding}, expected ascii, {' or '.join(_PLY_BYTE_ORDERS)}")
    byte_order = _PLY_BYTE_ORDERS[encoding]
    if any(column.dtype == "list" for rows in before for column in rows.columns):
        raise ValueError("found lists before the vertices, expected the vertices first")
    skipped = sum(rows.count * rows.record(byte_order).itemsize for rows in before)
    return _from_binary(vertices, body[skipped:], byte_order)


def _ply_elements(header: list[list[str]]) -> dict[str, _Rows]:
    elements: dict[str, _Rows] = {}
    for words in header:
        match words:
            case ["element", name, count]:
                elements[name] = _Rows([], _count(count))
                current = name
            case ["property", "list", _, _, name] if elements and current != "vertex":
                elements[current].columns.append(_Column(name, "list"))
            case ["property", kind, name] if elements and kind in _PLY_TYPES:
                elements[current].columns.append(_Column(name, _PLY_TYPES[kind]))
            case ["element" | "property", *_]:
                raise ValueError(f"found an unknown header line {' '.join(words)!r}")
    return elements


def _count(text: str) -> int:
    if not re.fullmatch(r"[0-9]{1,12}", text):
        raise ValueError(f"found a count of {text[:20]!r}, expected a number")
    return int(text)


def _read_pcd(path: Path) -> Points:
    header, body = _split_header(path.read_bytes(), r"DATA[ \t]+\w+", "PCD")
    entries = {words[0]: words[1:] for words in header}
    rows = _pcd_rows(entries)
    match entries["DATA"]:
        case ["ascii"]:
            return _from_text(rows, _text_lines(body))
        case ["binary"]:
            return _from_binary(rows, body, "<")
        case ["binary_compressed"]:
            return _from_compressed_pcd(path, rows, body)
    raise ValueError(f"found DATA {' '.join(entries['DATA'])}, expected ascii, binary or binary_compressed")


def _pcd_rows(entries: dict[str, list[str]]) -> _Rows:
    names = entries.get("FIELDS", entries.get("COLUMNS", []))
    sizes, kinds = entries.get("SIZE", []), entries.get("TYPE", [])
    values = [_count(text) for text in entries.get("COUNT", ["1"] * len(names))]
    if not names or not len(names) == len(sizes) == len(kinds) == len(values) or min(values) < 1:
        raise ValueError("found no FIELDS, SIZE, TYPE and COUNT of one length")
    dtypes = [kind.lower() + size for kind, size in zip(kinds, sizes, strict=True)]
    if unknown := [dtype for dtype in dtypes if not re.fullmatch(r"[iu][1248]|f[48]", dtype)]:
        raise ValueError(f"found a field of unknown TYPE and SIZE {unknown[0]!r}")
    if "POINTS" in entries:
        count = _count(" ".join(entries["POINTS"]))
    else:
        count = _count(" ".join(entries.get("WIDTH", []))) * _count(" ".join(entries.get("HEIGHT", [])))
    return _Rows([_Column(*column) for column in zip(names, dtypes, values, strict=True)], count)


def _from_compressed_pcd(path: Path, rows: _Rows, body: bytes) -> Points:
    rows.xyz()
    packed, unpacked = struct.unpack("<II", body[:8]) if len(body) >= 8 else (0, 0)
    if len(body) < 8 + packed or unpacked != rows.count * rows.record("<").itemsize:
        raise ValueError(f"found {max(len(body) - 8, 0)} bytes, not the {rows.count} points that it declares")
    try:
        import open3d  # slow to import, and needed for this one format only
    except ImportError as error:
        raise ValueError(f"compressed PCD needs Open3D, which fails to load: {error}; save it uncompressed") from error
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        cloud = open3d.io.read_point_cloud(path, remove_nan_points=False, remove_infinite_points=False)
    points = np.array(cloud.points, dtype=np.float64)
    if len(points) != rows.count:
        raise ValueError(f"found {len(points)} of the {rows.count} points that it declares, the data is damaged")
    return points


_READERS: dict[str, Callable[[Path], Points]] = {
    ".ply": _read_ply,
    ".pcd": _read_pcd,
    ".xyz": _read_xyz,
    ".npy": _read_npy,
}
FRAME_SUFFIXES = tuple(_READERS)
