"""Exceptions as one line for the user, with advice where that is known."""

from __future__ import annotations

import errno
import os

from pydantic import ValidationError

from pipeline.store.artifacts import ArtifactError
from schemas.errors import InputError, first_fault

AGAIN = "then give the same command again: what is complete is kept"
ADVICE = {
    errno.ENOSPC: f"free some space, {AGAIN}",
    errno.EDQUOT: f"free some space, {AGAIN}",
    errno.EFBIG: f"allow larger files (ulimit -f), {AGAIN}",
    errno.EACCES: f"check its permissions, {AGAIN}",
    errno.EPERM: f"check its permissions, {AGAIN}",
    errno.EROFS: f"give a place that can be written, {AGAIN}",
    errno.ENOMEM: f"allow more memory, {AGAIN}",
    errno.EMFILE: f"allow more open files (ulimit -n), {AGAIN}",
    errno.EAGAIN: f"allow more processes (ulimit -u), {AGAIN}",
    errno.ELOOP: "check its symbolic links",
}
NO_MEMORY = "can't allocate memory"  # torch raises a RuntimeError with this text
SHOWN_PATH = 200  # characters of a path


class ProcessDied(Exception):
    """A worker ended without reporting anything. The message is one line."""


def one_line(error: BaseException) -> str:
    """Format an exception as one line. The messages of InputError and ArtifactError stay as they are."""
    text = " ".join(str(error).split())
    match error:
        case InputError() | ArtifactError() | ProcessDied():
            return text
        case ValidationError():
            return first_fault(error, error.title)
        case OSError(errno=errno.ENAMETOOLONG, filename=where):
            return f"{_shortened(os.fsdecode(where))}: found a name too long for this system; give a shorter one"
        case OSError(errno=int(code), strerror=str(said)):
            where = error.filename2 or error.filename
            found = f"input or output: {said}" if where is None else f"{_shortened(os.fsdecode(where))}: {said}"
            return f"{found}; {ADVICE.get(code, f'see to that, {AGAIN}')}"
        case MemoryError() | RuntimeError() if isinstance(error, MemoryError) or NO_MEMORY in text:
            return f"found too little memory{f' ({text})' if text else ''}; allow more, {AGAIN}"
        case _:
            return f"{type(error).__name__}: {text}"


def _shortened(path: str) -> str:
    return path if len(path) <= SHOWN_PATH else f"{path[:SHOWN_PATH]}..."
