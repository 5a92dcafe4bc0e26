"""D-FAUST's registrations: HDF5 files with `faces` and an array (vertices, 3, frames) for each sequence."""

from __future__ import annotations

import hashlib
import importlib
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64

from schemas.errors import InputError
from stages.ingest.formats.triangles import FACES, checked_triangles
from stages.ingest.messages import TooLargeError, check_count, one_line, out_of_memory, too_large, unreadable

SUFFIXES = (".hdf5", ".h5")
_EXPECTED = "(vertices, 3, frames) of real numbers, as D-FAUST's registrations are"
_MOST_HASHED = 1 << 30  # bytes; larger sequences have a digest of the file's time. D-FAUST's largest has 70 MB
_LARGEST_CHUNK = 1 << 30
_BLOCK = 256  # vertices


def sequence_names(path: Path) -> list[str]:
    """The sequences of a file. Raises InputError, as all functions here, if it cannot be read or holds none."""
    with _opened(path) as file:
        names = [name for name, entry in file.items() if name != FACES and hasattr(entry, "shape")]
        if not names:
            raise InputError(f"{path}: found no sequence among {_named(list(file))}, expected arrays {_EXPECTED}")
        return names


def sequence_digest(path: Path, name: str) -> str:
    """SHA-256 (hex) of a sequence's numbers and the faces, or of the file's time if the sequence is huge."""
    with _opened(path) as file:
        digest = hashlib.sha256()
        for entry in (_entry(file, name, path), file.get(FACES)):
            if entry is None:
                continue
            digest.update(f"{entry.shape} {entry.dtype}".encode())
            if math.prod(entry.shape) * entry.dtype.itemsize > _MOST_HASHED or entry.dtype.hasobject:
                status = path.stat()
                digest.update(f"{path.name} {name} {status.st_size} {status.st_mtime_ns}".encode())
            elif entry.shape:
                for start in range(0, entry.shape[0], _BLOCK):
                    digest.update(np.ascontiguousarray(entry[start : start + _BLOCK]).tobytes())
        return digest.hexdigest()


def frame_count(path: Path, name: str) -> int:
    """The number of a sequence's frames."""
    with _opened(path) as file:
        return int(_sequence(file, name, path).shape[2])


def read_registrations(
    path: Path, name: str, frames: range, most: int
) -> tuple[Float64[np.ndarray, "frames vertices 3"], Int64[np.ndarray, "triangles 3"] | None]:
    """Read the vertices of a sequence's chosen frames, and the triangles if the file has them.

    More than `most` vertices in these frames are refused before they are read.
    """
    with _opened(path) as file:
        entry = _sequence(file, name, path)
        count = entry.shape[0]
        try:
            check_count(count * len(frames), most)
        except TooLargeError as error:
            raise too_large(path, error, most) from error
        _check_chunks(entry, path, name)
        vertices = np.moveaxis(entry[:, :, frames.start : frames.stop : frames.step], 2, 0).astype(np.float64)
        faces = file.get(FACES)
        if faces is None:
            return vertices, None
        if not hasattr(faces, "shape") or math.prod(faces.shape) > 3 * most:
            raise InputError(
                f"{path}: {FACES}: found {getattr(faces, 'shape', 'a group')}, expected (triangles, 3) of at most "
                f"{most:,} triangles; correct the file"
            )
        _check_chunks(faces, path, FACES)
        return vertices, checked_triangles(faces[...], count, f"{path}: {FACES}")


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open an HDF5 file. Errors while it is read become InputError."""
    h5py = _h5py()
    try:
        with path.open("rb"):
            pass
    except OSError as error:
        raise unreadable(path, error) from error
    try:
        with h5py.File(path, "r", locking=False) as file:
            yield file
    except InputError:
        raise
    except MemoryError as error:
        raise out_of_memory(path) from error
    except Exception as error:  # HDF5 raises many kinds of errors for damaged files
        found = "cannot be read as HDF5" if h5py.is_hdf5(path) else "is no HDF5 file"
        raise InputError(
            f"{path}: {found} ({one_line(error)}), expected registrations such as D-FAUST's; download it again"
        ) from error


def _h5py() -> Any:
    try:
        return importlib.import_module("h5py")
    except ImportError as error:
        raise InputError(
            f"dataset dfaust: cannot import h5py ({error}); run `pip install rearticulate[humans]`"
        ) from error


def _entry(file: Any, name: str, path: Path) -> Any:
    entry = file.get(name)
    if entry is None or not hasattr(entry, "shape"):
        raise InputError(
            f"{path}: found no sequence {name!r}, expected one of {_named(list(file))}; check the spelling"
        )
    return entry


def _sequence(file: Any, name: str, path: Path) -> Any:
    """The array of a sequence, before it is read."""
    entry = _entry(file, name, path)
    if len(entry.shape) != 3 or entry.shape[1] != 3 or entry.dtype.kind not in "iuf":
        raise InputError(
            f"{path}: {name}: found shape {entry.shape} of {entry.dtype}, expected {_EXPECTED}; transpose it"
        )
    return entry


def _check_chunks(entry: Any, path: Path, name: str) -> None:
    """Raise InputError for huge chunks, since HDF5 always reads whole ones."""
    size = math.prod(entry.chunks or ()) * entry.dtype.itemsize
    if size > _LARGEST_CHUNK:
        raise InputError(
            f"{path}: {name}: found chunks of {size:,} bytes, expected at most {_LARGEST_CHUNK:,}; write the file anew"
        )


def _named(names: list[str]) -> str:
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "") if names else "nothing"
