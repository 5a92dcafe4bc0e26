"""Arrays of points in numpy's files .npy and .npz. Only the needed parts of an .npz are read.

Sizes are checked by the headers before anything is read, and nothing is ever unpickled.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np

from schemas.errors import InputError
from stages.ingest.formats.cloud import Cloud, Points
from stages.ingest.formats.disguises import disguise
from stages.ingest.messages import TooLargeError, check_count, one_line, out_of_memory, unreadable

_MOST_COLUMNS = 16  # of a point's coordinates, colour and normal; an image has more
_MOST_BYTES = 2 << 30
_BLOCK = 1 << 22  # bytes
_MOST_BYTES_OF_POINT = 1 << 16
# raised by numpy's parser, besides ValueError, for a damaged header
_HEADER_ERRORS = (SyntaxError, TypeError, OverflowError, TokenError, RecursionError)
PER_FRAME = "save one .npy for each frame in a folder"


@dataclass(frozen=True)
class Member:
    """One array of an .npz, as its header declares it. `problem` explains why it is not a plain array."""

    name: str
    shape: tuple[int, ...] = ()
    dtype: np.dtype[Any] = field(default_factory=lambda: np.dtype(np.void))
    fortran: bool = False
    header: int = 0
    info: zipfile.ZipInfo | None = None
    problem: str = ""

    @property
    def nbytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def points_shape(self) -> tuple[int, ...]:
        """The shape with coordinates as the last axis; empty if the array holds no points."""
        return points_shape(self.shape, self.dtype)


def points_shape(shape: tuple[int, ...], dtype: np.dtype[Any]) -> tuple[int, ...]:
    """The shape (..., points, 3) of an array with at least three columns or with fields x, y and z; else ()."""
    if dtype.names:
        plain = all(name in dtype.names and dtype[name].kind in "iuf" for name in "xyz")
        return (*shape, 3) if plain else ()
    if dtype.kind not in "iuf" or not shape or not 3 <= shape[-1] <= _MOST_COLUMNS:
        return ()
    return (*shape[:-1], 3)


def as_points(array: Any) -> Points:
    """Convert the first three columns of one frame's array, or its fields x, y and z, to float64.

    Raises ValueError for anything but real numbers of shape (points, 3 or more).
    """
    if not isinstance(array, np.ndarray):
        raise ValueError(f"found a {type(array).__name__}, expected an array of shape (points, 3)")
    found = f"found an array of shape {array.shape}"
    if array.dtype.names is None and array.dtype.kind not in "iuf":
        raise ValueError(f"found dtype {array.dtype}, expected real numbers")
    shape = points_shape(array.shape, array.dtype)
    if len(shape) == 3:
        raise ValueError(f"{found} among frames; give that file itself as the sequence")
    if array.ndim == 2 and array.shape[0] == 3 and array.shape[1] > _MOST_COLUMNS:
        raise ValueError(f"{found}, expected (points, 3); save its transpose")
    if len(shape) != 2:
        raise ValueError(f"{found}, expected (points, 3)")
    return _coordinates(array).astype(np.float64)


def map_array(path: Path) -> np.ndarray:
    """Map a .npy file read-only. Its header is checked against its size, and nothing is loaded.

    Raises ValueError or OSError for a file that is not a whole array of plain numbers.
    """
    try:
        return np.lib.format.open_memmap(path, mode="r")
    except ValueError as error:
        if "Python objects" in str(error):  # numpy's own message advises to unpickle
            raise ValueError(f"found Python objects, which are never unpickled; {PER_FRAME}") from error
        if "magic string" in str(error):
            raise ValueError("found no .npy header") from error
        raise
    except _HEADER_ERRORS as error:
        raise ValueError(f"found a damaged header ({one_line(error)})") from error


def npy_header(path: Path) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """The shape and type that a .npy file declares. The file may be truncated. Raises ValueError or OSError."""
    with path.open("rb") as file:
        try:
            shape, _, dtype = _header(file)
        except _HEADER_ERRORS as error:
            raise ValueError(f"found a damaged header ({one_line(error)})") from error
    return shape, dtype


def read_npy(path: Path, most: int) -> Cloud:
    """Read the points of a .npy file of one frame. Raises ValueError or OSError, also for more than `most`."""
    array = map_array(path)
    check_count(len(array) if array.ndim else 0, most)
    return Cloud(as_points(np.asarray(array)))


def read_organised(path: Path, most: int) -> Cloud:
    """Read the points of a .npy file of one organised frame (rows, columns, 3 or more). Raises as `read_npy` does."""
    array = map_array(path)
    check_count(math.prod(array.shape[:2]), most)
    return Cloud(as_points(np.asarray(array).reshape(-1, *array.shape[2:])))


def load_npz(path: Path, wanted: Collection[str] | None = None, most_bytes: int = _MOST_BYTES) -> dict[str, np.ndarray]:
    """Load the arrays of an .npz, or the `wanted` ones that it has. Others are neither read nor checked.

    Raises InputError if it is damaged, holds pickled objects or declares more than `most_bytes`.
    """
    with open_npz(path) as archive:
        members = [member for member in archive.members() if wanted is None or member.name in wanted]
        if problems := [member for member in members if member.problem]:
            raise ValueError(f"'{problems[0].name}' {problems[0].problem}")
        if (declared := sum(member.nbytes for member in members)) > most_bytes:
            raise InputError(
                f"{path}: found arrays of {declared:,} bytes, expected at most {most_bytes:,}; check how it was written"
            )
        return {member.name: archive.read(member) for member in members}


class Archive:
    """An open .npz."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._zip = archive

    def members(self) -> list[Member]:
        """Its arrays in the order in which they were saved, by their headers alone."""
        return [self._member(info) for info in self._zip.infolist()]

    def read(self, member: Member) -> np.ndarray:
        """Read a whole array. Check its size before."""
        data = bytearray(member.nbytes)
        with self._data(member) as file, memoryview(data) as view:
            for start in range(0, len(data), _BLOCK):
                view[start : start + _BLOCK] = _exactly(file, min(_BLOCK, len(data) - start))
            file.read(1)  # zipfile checks the sum at the end
        return np.frombuffer(data, member.dtype).reshape(member.shape, order="F" if member.fortran else "C")

    def read_frames(self, member: Member, step: int, most: int) -> Iterator[Points]:
        """Yield the points of every `step`-th frame of an array (frames, points, 3 or more).

        Besides these points, only one block of the array is in memory.
        """
        frames, count = member.points_shape[:2]
        check_count(count * len(range(0, frames, step)), most)
        _check_width(member)
        with self._data(member) as file:
            yield from (_by_columns if member.fortran else _by_rows)(file, member, (frames, count), step)
            while file.read(_BLOCK):  # zipfile checks the sum at the end
                pass

    def read_frame(self, member: Member, most: int) -> Points:
        """Read the points of an array (points, 3 or more), as `read_frames` does."""
        (points,) = self.read_frames(replace(member, shape=(1, *member.shape)), 1, most)
        return points

    def _member(self, info: zipfile.ZipInfo) -> Member:
        name = info.filename.removesuffix(".npy")
        if name == info.filename:
            return Member(name, problem="is no array")
        with self._zip.open(info) as file:
            try:
                shape, fortran, dtype = _header(file)
            except (ValueError, *_HEADER_ERRORS) as error:
                return Member(name, problem=f"is no array ({one_line(error)})")
            member = Member(name, shape, dtype, fortran, file.tell(), info)
        if dtype.hasobject:
            return Member(name, shape, problem="holds Python objects, which are never unpickled")
        if min(shape, default=0) < 0 or member.header + member.nbytes != info.file_size:
            held = info.file_size - member.header
            return Member(name, shape, problem=f"declares {member.nbytes} bytes, but holds {held}")
        return member

    @contextmanager
    def _data(self, member: Member) -> Iterator[IO[bytes]]:
        with self._zip.open(member.info or f"{member.name}.npy") as file:
            _exactly(file, member.header)
            yield file


@contextmanager
def open_npz(path: Path) -> Iterator[Archive]:
    """Open an .npz to list and read its members. Raises InputError, also for errors while it is read."""
    try:
        file = path.open("rb")
    except OSError as error:
        raise unreadable(path, error) from error
    try:
        with file:
            if not zipfile.is_zipfile(file):
                raise zipfile.BadZipFile("it is no zip archive")
            with zipfile.ZipFile(file) as archive:
                yield Archive(archive)
    except (InputError, TooLargeError):
        raise
    except MemoryError as error:
        raise out_of_memory(path) from error
    except Exception as error:  # zipfile and its decompressors raise many kinds of errors for damaged files
        if (found := disguise(path)) and not zipfile.is_zipfile(path):
            raise InputError(f"{path}: {found}") from error
        raise InputError(
            f"{path}: cannot be read as .npz ({one_line(error)}), expected plain numeric arrays; save it with np.savez"
        ) from error


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read a .npy header: the shape, whether the order is Fortran's, and the type."""
    version = np.lib.format.read_magic(file)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"it is of the unknown .npy version {version}")
    reads = np.lib.format
    return reads.read_array_header_1_0(file) if version == (1, 0) else reads.read_array_header_2_0(file)


def _check_width(member: Member) -> None:
    width = member.dtype.itemsize * math.prod(member.shape[2:])
    if width > _MOST_BYTES_OF_POINT:
        raise ValueError(
            f"'{member.name}' declares {width:,} bytes for each point, expected at most {_MOST_BYTES_OF_POINT:,}"
        )


def _by_rows(file: IO[bytes], member: Member, shape: tuple[int, int], step: int) -> Iterator[Points]:
    """Yield every `step`-th frame of (frames, points) in C order, where a frame's points are contiguous."""
    frames, count = shape
    columns = member.shape[2:]
    width = member.dtype.itemsize * math.prod(columns)
    at_once = max(_BLOCK // max(width, 1), 1)
    for index in range(frames):
        wanted = index % step == 0
        frame = np.empty((count if wanted else 0, 3))
        for start in range(0, count, at_once):
            rows = min(at_once, count - start)
            data = _exactly(file, rows * width)
            if wanted:
                block = np.frombuffer(data, member.dtype).reshape(rows, *columns)
                frame[start : start + rows] = _coordinates(block)
        if wanted:
            yield frame


def _by_columns(file: IO[bytes], member: Member, shape: tuple[int, int], step: int) -> Iterator[Points]:
    """Yield every `step`-th frame of (frames, points) in Fortran's order: all first points, all second ones, ..."""
    frames, count = shape
    points = np.empty((len(range(0, frames, step)), count, 3))
    at_once = max(_BLOCK // max(member.dtype.itemsize, 1), 1)
    for column in range(1 if member.dtype.names else 3):
        for start in range(0, frames * count, at_once):
            entries = np.arange(start, min(start + at_once, frames * count))
            block = np.frombuffer(_exactly(file, len(entries) * member.dtype.itemsize), member.dtype)
            point, frame = np.divmod(entries, frames)
            wanted = frame % step == 0
            place = slice(None) if member.dtype.names else column
            values = _coordinates(block) if member.dtype.names else block
            points[frame[wanted] // step, point[wanted], place] = values[wanted]
    yield from points


def _coordinates(array: np.ndarray) -> np.ndarray:
    if array.dtype.names:
        return np.stack([array[name] for name in "xyz"], axis=-1)
    return array[..., :3]


def _exactly(file: IO[bytes], count: int) -> bytes:
    data = file.read(count)
    if len(data) != count:
        raise ValueError(f"it ends {count - len(data)} bytes early")
    return data
