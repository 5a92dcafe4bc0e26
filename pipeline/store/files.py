"""Files that other programs may read, or write, at any moment. No symbolic link is followed where one is written."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
import uuid
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO

from schemas.errors import InputError

PARTIAL = ".reart-partial"  # no file of the user's is called so
ANY_PARTIAL = f".*{PARTIAL}"
MOST_BYTES = 256 * 2**20  # of a description, settings, targets or an evaluation; none comes near
_FRESH = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW


def read_whole(path: Path) -> bytes:
    """The content of a file that people write. Raises OSError, also for one too large or that may never end."""
    found = os.stat(path)
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    if found.st_size > MOST_BYTES:
        size = f"it has {found.st_size >> 20} MiB, expected at most {MOST_BYTES >> 20}"
        raise OSError(errno.EFBIG, size, str(path))
    return path.read_bytes()


def write_atomically(path: Path, content: bytes) -> None:
    """Write beside `path`, then rename: a reader sees the old content or the new, never half of it.

    Any number of writers may write the same path; the last one's content stays. What killed writers left is removed.
    Raises OSError, and then leaves nothing behind.
    """
    remove_abandoned(path.parent.glob(ANY_PARTIAL))
    with naming_file(path), _partial(path.parent) as (partial, file):
        file.write(content)
        file.flush()
        os.replace(partial, path)


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by their paths in a folder, each whole or not at all, and the first of them last. Raises OSError."""
    for name in reversed(list(files)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / name, files[name])


def open_fresh(path: Path) -> IO[str]:
    """A new text file in the place of what is there, which its other users keep. Raises OSError."""
    while True:
        path.unlink(missing_ok=True)
        with contextlib.suppress(FileExistsError):  # another one was faster
            return open(os.open(path, _FRESH, 0o666), "w", buffering=1, encoding="utf-8", errors="backslashreplace")


def check_own_folder(folder: Path) -> None:
    """Raises InputError where a folder of our own is somewhere else, or a file."""
    advice = "remove it, or name another folder"
    if folder.is_symlink():
        raise InputError(f"{folder}: found a symbolic link, expected a folder; {advice}")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: found a file, expected a folder; {advice}")


def remove_abandoned(partials: Iterable[Path]) -> None:
    """Remove what killed writers left. A living one holds a lock."""
    for partial in partials:
        with (
            contextlib.suppress(OSError),
            open(os.open(partial, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file,
        ):
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            partial.unlink()


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Let no other process that asks for it in the same way do its work in a folder meanwhile. Raises OSError."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        _lock(handle)
        yield
    finally:
        os.close(handle)


@contextlib.contextmanager
def naming_file(path: Path) -> Iterator[None]:
    """Put the file's name into an OSError that lacks it, as one of writing does."""
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno is not None:
            error.filename = str(path)
        raise


@contextlib.contextmanager
def _partial(folder: Path) -> Iterator[tuple[Path, IO[bytes]]]:
    """A new file in a folder, locked against sweepers. It is gone at the end, unless it was renamed."""
    while True:
        partial = folder / f".{uuid.uuid4().hex[:12]}{PARTIAL}"
        with open(os.open(partial, _FRESH, 0o666), "wb") as file:
            try:
                _lock(file.fileno())
                if partial.exists():  # no sweeper was faster
                    yield partial, file
                    return
            finally:
                partial.unlink(missing_ok=True)


def _lock(handle: int) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
    except OSError as error:
        if error.errno not in (errno.ENOTSUP, errno.ENOSYS, errno.ENOLCK, errno.EINVAL):
            raise  # else a file system without locks: there nobody sweeps either
