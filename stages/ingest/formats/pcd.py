"""PCD, as text, binary or compressed.

It is parsed here, as PLY is, since Open3D returns zeros for bad lines. Open3D still unpacks compressed files, whose
size can be checked.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from stages.ingest.formats.cloud import Cloud, Colours, as_colours
from stages.ingest.formats.rows import (
    Column,
    Rows,
    declared_count,
    from_binary,
    from_text,
    split_header,
    text_lines,
)
from stages.ingest.messages import check_count
from stages.kernels.surfaces.open3d_library import load_open3d
from stages.support.open3d_use import needing_open3d

_PACKED = ("rgb", "rgba")


def read_pcd(path: Path, most: int) -> Cloud:
    """Read the points and their colours. Raises ValueError or OSError, also for more than `most`."""
    with path.open("rb") as file:
        header, start = split_header(file, r"DATA[ \t]+\w+", "PCD")
        entries = {words[0]: words[1:] for words in header}
        rows = _rows(entries)
        xyz, rgb = rows.xyz(), _colour_columns(rows)
        match entries["DATA"]:
            case ["ascii"]:
                columns = list(from_text(rows, xyz + rgb, text_lines(file, start), most).T)
            case ["binary"]:
                columns = from_binary(rows, xyz + rgb, path, start, "<", most)
            case ["binary_compressed"]:
                return _from_compressed(path, rows, start, most)
            case other:
                raise ValueError(f"found DATA {' '.join(other)}, expected ascii, binary or binary_compressed")
    points = np.stack(columns[:3], axis=1).astype(np.float64)
    types = [np.dtype(rows.columns[index].dtype) for index in rgb]
    colours = [column.astype(dtype) for column, dtype in zip(columns[3:], types, strict=True)]
    if len(rgb) == 1:
        return Cloud(points, _unpacked(colours[0]))
    return Cloud(points, as_colours(np.stack(colours, axis=1)) if colours else None)


def _colour_columns(rows: Rows) -> list[int]:
    """The column of colours packed into 32 bits, or the columns of red, green and blue."""
    for index, column in enumerate(rows.columns):
        if column.name.lower() in _PACKED and column.dtype[1:] == "4" and column.values == 1:
            return [index]
    return rows.rgb()


def _unpacked(packed: np.ndarray) -> Colours:
    """Split 32 bits, which may be declared as a real number, into red, green and blue."""
    bits = np.ascontiguousarray(packed).view(np.uint32)
    return np.stack([bits >> shift & 0xFF for shift in (16, 8, 0)], axis=1).astype(np.uint8)


def _rows(entries: dict[str, list[str]]) -> Rows:
    names = entries.get("FIELDS", entries.get("COLUMNS", []))
    sizes, kinds = entries.get("SIZE", []), entries.get("TYPE", [])
    values = [declared_count(text) for text in entries.get("COUNT", ["1"] * len(names))]
    if not names or not len(names) == len(sizes) == len(kinds) == len(values) or min(values) < 1:
        raise ValueError("found no FIELDS, SIZE, TYPE and COUNT of one length")
    dtypes = [kind.lower() + size for kind, size in zip(kinds, sizes, strict=True)]
    if unknown := [dtype for dtype in dtypes if not re.fullmatch(r"[iu][1248]|f[48]", dtype)]:
        raise ValueError(f"found a field of unknown TYPE and SIZE {unknown[0]!r}")
    columns = [Column(*column) for column in zip(names, dtypes, values, strict=True)]
    return Rows(columns, _point_count(entries))


def _point_count(entries: dict[str, list[str]]) -> int:
    """The number of points in the header. Raises ValueError if the header contradicts itself."""
    names = [name for name in ("POINTS", "WIDTH", "HEIGHT") if name in entries]
    counts = {name: declared_count(" ".join(entries[name])) for name in names}
    if "WIDTH" not in counts or "HEIGHT" not in counts:
        if "POINTS" not in counts:
            raise ValueError("found neither POINTS nor WIDTH and HEIGHT")
        return counts["POINTS"]
    area = counts["WIDTH"] * counts["HEIGHT"]
    if counts.get("POINTS", area) != area:
        raise ValueError(
            f"found POINTS {counts['POINTS']}, but WIDTH {counts['WIDTH']} x HEIGHT {counts['HEIGHT']}, "
            "expected as many points"
        )
    return area


def _from_compressed(path: Path, rows: Rows, start: int, most: int) -> Cloud:
    check_count(rows.count, most)
    with path.open("rb") as file:
        file.seek(start)
        sizes = file.read(8)
    held = max(path.stat().st_size - start - 8, 0)
    packed, unpacked = struct.unpack("<II", sizes) if len(sizes) == 8 else (0, 0)
    width = sum(np.dtype(column.dtype).itemsize * column.values for column in rows.columns)
    if len(sizes) < 8 or held < packed or unpacked != rows.count * width:
        raise ValueError(f"found {held} bytes, not the {rows.count} points that it declares")
    with needing_open3d(f"{path}: save the clouds as uncompressed PCD or as PLY, since this one takes Open3D"):
        open3d = load_open3d()
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        cloud = open3d.io.read_point_cloud(path, remove_nan_points=False, remove_infinite_points=False)
    points = np.array(cloud.points, dtype=np.float64)
    if len(points) != rows.count:
        raise ValueError(f"found {len(points)} of the {rows.count} points that it declares, the data is damaged")
    return Cloud(points, as_colours(np.asarray(cloud.colors)) if cloud.has_colors() else None)
