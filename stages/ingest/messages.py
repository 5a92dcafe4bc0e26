"""What the readers of input say where they cannot go on."""

from __future__ import annotations

from pathlib import Path

from schemas.errors import InputError


class TooLargeError(ValueError):
    """The input declares or holds more points than `ingest.max_points`."""


def one_line(error: BaseException) -> str:
    """What an exception says, as one short line."""
    return " ".join(str(error).split())[:300].rstrip(".") or type(error).__name__


def unreadable(path: Path, error: OSError) -> InputError:
    """The error for a file or folder that the system does not let us read."""
    return InputError(
        f"{path}: cannot be read ({error.strerror or one_line(error)}); check its permissions and the disk"
    )


def out_of_memory(path: Path) -> InputError:
    """The error for a file that may well be sound."""
    return InputError(
        f"{path}: reading it takes more memory than there is; thin the clouds, "
        "take every so many-th frame (ingest.every) or free memory"
    )


def check_count(count: int, most: int) -> None:
    """Raise TooLargeError for more points than `most`."""
    if count > most:
        raise TooLargeError(f"found {count:,} points, too many with those of the frames before")


def too_large(path: Path, error: TooLargeError, limit: int) -> InputError:
    """The error for a sequence of more points than `limit`."""
    return InputError(
        f"{path}: {one_line(error)}, expected at most {limit:,} in all frames (ingest.max_points); "
        "thin the clouds or raise the setting"
    )
