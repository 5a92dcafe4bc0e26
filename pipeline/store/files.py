"""Files that other programs may read or write at any moment. Writing follows no symbolic links."""

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

PARTIAL = ".reart-partial"  # no file of the user has this ending
ANY_PARTIAL = f".*{PARTIAL}"
MOST_BYTES = 256 * 2**20  # far more than any description, settings, targets or evaluation
_FRESH = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW


def read_whole(path: Path) -> bytes:
    """Read a file that people write. Raises OSError, also for one that is too large or may never end."""
    found = os.stat(path)
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    if found.st_size > MOST_BYTES:
        size = f"it has {found.st_size >> 20} MiB, expected at most {MOST_BYTES >> 20}"
        raise OSError(errno.EFBIG, size, str(path))
    return path.read_bytes()


def write_atomically(path: Path, content: bytes) -> None:
    """Write beside `path`, then rename. A reader sees either the old content or the new.

    Several writers may write the same path; the content of the last one stays. The remains of killed writers are
    removed. Raises OSError, and then leaves nothing behind.
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
    """Open a new text file in place of an existing one, which stays open for its other users. Raises OSError."""
    while True:
        path.unlink(missing_ok=True)
        with contextlib.suppress(FileExistsError):  # another one was faster
            return open(os.open(path, _FRESH, 0o666), "w", buffering=1, encoding="utf-8", errors="backslashreplace")


def check_own_folder(folder: Path) -> None:
    """Raise InputError if one of our own folders is a link or a file."""
    advice = "remove it, or name another folder"
    if folder.is_symlink():
        raise InputError(f"{folder}: found a symbolic link, expected a folder; {advice}")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: found a file, expected a folder; {advice}")


def remove_abandoned(partials: Iterable[Path]) -> None:
    """Remove the remains of killed writers. A living writer holds a lock on its file."""
    for partial in partials:
        with (
            contextlib.suppress(OSError),
            open(os.open(partial, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file,
        ):
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            partial.unlink()


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Hold a lock on a folder, so that other processes that take it wait. Raises OSError."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        _lock(handle)
        yield
    finally:
        os.close(handle)


@contextlib.contextmanager
def naming_file(path: Path) -> Iterator[None]:
    """Add the file's name to an OSError that lacks it, as those of writing do."""
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno is not None:
            error.filename = str(path)
        raise


@contextlib.contextmanager
def _partial(folder: Path) -> Iterator[tuple[Path, IO[bytes]]]:
    """A new file in a folder, which is locked against sweepers. It is removed at the end unless it was renamed."""
    while True:
        partial = folder / f".{uuid.uuid4().hex[:12]}{PARTIAL}"
        with open(os.open(partial, _FRESH, 0o666), "wb") as file:
            try:
                _lock(file.fileno())
                if partial.exists():  # no sweeper has removed it
                    yield partial, file
                    return
            finally:
                partial.unlink(missing_ok=True)


def _lock(handle: int) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
    except OSError as error:
        if error.errno not in (errno.ENOTSUP, errno.ENOSYS, errno.ENOLCK, errno.EINVAL):
            raise  # else on a file system without locks, where nobody sweeps either
