"""Files of laser scanners: .e57 by pye57, .las and .laz by laspy, which the extra `scanners` installs.

Sizes are checked against the file before those libraries read it, and an .e57 with a document type declaration, which
may name other files, is refused.
"""

from __future__ import annotations

import importlib
import struct
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from schemas.errors import InputError
from stages.ingest.formats.cloud import Cloud, Colours, as_colours
from stages.ingest.messages import TooLargeError, check_count

_RGB = ("red", "green", "blue")
_E57_RGB = ("colorRed", "colorGreen", "colorBlue")
_E57_HEADER = struct.Struct("<8sIIQQQQ")
_CHECKSUM = 4  # bytes at the end of every page of an .e57
_MOST_XML = 2**26  # bytes
_LEAST_VLR, _LEAST_EVLR = 54, 60  # bytes of a record before the points, and of an extended one after them
_LAS_1_4 = 375  # bytes of the header of LAS 1.4, which has the number of points at 247
_AT_ONCE = 1_000_000  # points


def read_e57(path: Path, most: int) -> Cloud:
    """Read the points of all scans of an .e57 in their common coordinates. Invalid ones are left out.

    Raises ValueError or OSError for a damaged file, TooLargeError for more than `most` points, and InputError where
    pye57 is not installed.
    """
    _check_e57(path)
    pye57 = _library("pye57", path)
    try:
        with pye57.E57(str(path)) as file:
            headers = [file.get_header(index) for index in range(file.scan_count)]
            check_count(sum(header.point_count for header in headers), most)
            scans = [_e57_scan(file, index, header) for index, header in enumerate(headers) if header.point_count]
    except (TooLargeError, MemoryError):
        raise
    except Exception as error:  # libE57Format has errors of its own, which are no ValueError
        raise ValueError(f"cannot be read as .e57 ({error!r:.200})") from error
    return _joined(scans)


def _e57_scan(file: Any, index: int, header: Any) -> Cloud:
    coloured = all(name in header.point_fields for name in _E57_RGB)
    try:
        data = file.read_scan(index, colors=coloured, ignore_missing_fields=True)
    except Exception:  # such as colours of 16 bits, which pye57 has no room for
        if not coloured:
            raise
        data = file.read_scan(index, colors=False, ignore_missing_fields=True)
    points = np.stack([data[f"cartesian{axis}"] for axis in "XYZ"], axis=1).astype(np.float64)
    colours = np.stack([data[name] for name in _E57_RGB], axis=1) if _E57_RGB[0] in data else None
    return Cloud(points, None if colours is None else as_colours(colours))


def _check_e57(path: Path) -> None:
    """Raise ValueError unless an .e57 is as long as it declares and its XML declares no document type."""
    held = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_E57_HEADER.size)
        if len(head) < _E57_HEADER.size or not head.startswith(b"ASTM-E57"):
            raise ValueError("found no header of an .e57")
        _, _, _, length, xml_start, xml_length, page = _E57_HEADER.unpack(head)
        if length != held:
            raise ValueError(f"found {held} of the {length} bytes that it declares")
        if page <= _CHECKSUM or held % page or xml_start >= held or xml_length > min(held, _MOST_XML):
            raise ValueError(f"found an XML section of {xml_length} bytes at {xml_start} declared in {held} bytes")
        first = xml_start // page
        file.seek(first * page)
        pages = -(-(xml_start % page + xml_length) // (page - _CHECKSUM)) + 1
        data = file.read(pages * page)
    logical = b"".join(data[start : start + page - _CHECKSUM] for start in range(0, len(data), page))
    if b"<!" in logical[xml_start % page :][:xml_length].replace(b"<![CDATA[", b"").replace(b"<!--", b""):
        raise ValueError("found a document type declaration in its XML, expected none; export it again")


def read_las(path: Path, most: int) -> Cloud:
    """Read the points of a .las or .laz. Raises as `read_e57` does; laspy reads them."""
    count = _check_las(path)
    check_count(count, most)
    laspy = _library("laspy", path)
    try:
        with laspy.open(path, laz_backend=(laspy.LazBackend.Lazrs, laspy.LazBackend.Laszip)) as reader:  # one thread
            scans = [_las_points(points) for points in reader.chunk_iterator(_AT_ONCE)]
    except MemoryError:
        raise
    except Exception as error:  # laspy and its decompressors have errors of their own
        if path.suffix.lower() == ".laz" and find_spec("lazrs") is None:
            raise _missing("lazrs", path) from error
        raise ValueError(f"cannot be read as .las ({error!r:.200})") from error
    cloud = _joined(scans)
    if len(cloud.points) != count:
        raise ValueError(f"found {len(cloud.points)} of the {count} points that it declares")
    return cloud


def _las_points(points: Any) -> Cloud:
    xyz = np.stack([np.asarray(points[axis], dtype=np.float64) for axis in "xyz"], axis=1)
    if not set(_RGB) <= set(points.point_format.dimension_names):
        return Cloud(xyz)
    return Cloud(xyz, np.stack([np.asarray(points[name]) for name in _RGB], axis=1))


def _check_las(path: Path) -> int:
    """The number of points of a .las or .laz. Raises ValueError unless the sizes in its header fit the file."""
    held = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_LAS_1_4)
    if len(head) < 227 or not head.startswith(b"LASF"):
        raise ValueError("found no header of a .las")
    minor, size, start, vlrs, kind, record, count = head[25], *struct.unpack("<HIIBHI", head[94:111])
    if minor >= 4:
        if len(head) < _LAS_1_4:
            raise ValueError("found no whole header of a .las")
        start_evlrs, evlrs, count = struct.unpack("<QIQ", head[235:255])
        if evlrs and start_evlrs + evlrs * _LEAST_EVLR > held:
            raise ValueError(f"found {evlrs} extended records declared in {held} bytes")
    if not size <= start <= held or size + vlrs * _LEAST_VLR > start:
        raise ValueError(f"found {vlrs} records and points from byte {start} on declared in {held} bytes")
    packed = bool(kind & 0x80)
    if not packed and start + count * record > held:
        raise ValueError(f"found {max(held - start, 0) // max(record, 1)} of the {count} points that it declares")
    return int(count)


def _joined(scans: list[Cloud]) -> Cloud:
    """All scans in one; without colours where one has none."""
    points = np.concatenate([np.zeros((0, 3)), *(scan.points for scan in scans)])
    colours = [scan.colours for scan in scans if scan.colours is not None]
    known: Colours | None = None
    if scans and len(colours) == len(scans):
        known = as_colours(np.concatenate(colours))  # their range shows in all of them together
    return Cloud(points, known)


def _library(name: str, path: Path) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise _missing(name, path) from error


def _missing(name: str, path: Path) -> InputError:
    return InputError(
        f"{path}: reading it takes the package {name}, which is not installed; "
        "run `pip install rearticulate[scanners]`, or convert the file to .ply"
    )
