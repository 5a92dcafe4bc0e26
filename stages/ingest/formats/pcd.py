"""PCD, as text, binary or compressed.

It is parsed here, as PLY is, since Open3D returns zeros for bad lines. Open3D still unpacks compressed files, whose
size can be checked.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from stages.ingest.formats.rows import (
    Column,
    Points,
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


def read_pcd(path: Path, most: int) -> Points:
    """Read the coordinates of all points. Raises ValueError or OSError, also for more than `most`."""
    with path.open("rb") as file:
        header, start = split_header(file, r"DATA[ \t]+\w+", "PCD")
        entries = {words[0]: words[1:] for words in header}
        rows = _rows(entries)
        match entries["DATA"]:
            case ["ascii"]:
                return from_text(rows, text_lines(file, start), most)
            case ["binary"]:
                return from_binary(rows, path, start, "<", most)
            case ["binary_compressed"]:
                return _from_compressed(path, rows, start, most)
    raise ValueError(f"found DATA {' '.join(entries['DATA'])}, expected ascii, binary or binary_compressed")


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


def _from_compressed(path: Path, rows: Rows, start: int, most: int) -> Points:
    rows.xyz()
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
    return points
