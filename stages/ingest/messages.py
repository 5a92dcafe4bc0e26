"""Errors of the readers of input."""

from __future__ import annotations

from pathlib import Path

from schemas.errors import InputError


class TooLargeError(ValueError):
    """The input declares or holds more points than allowed."""

    def __init__(self, count: int, most: int) -> None:
        super().__init__(f"found {count:,} points, expected at most {most:,}")
        self.count = count
        self.most = most


def one_line(error: BaseException) -> str:
    """Format an exception as one short line."""
    return " ".join(str(error).split())[:300].rstrip(".") or type(error).__name__


def unreadable(path: Path, error: OSError) -> InputError:
    """The error for a file or folder that the system does not allow us to read."""
    return InputError(
        f"{path}: cannot be read ({error.strerror or one_line(error)}); check its permissions and the disk"
    )


def out_of_memory(path: Path) -> InputError:
    """The error for a file that could not be read for lack of memory. The file may be intact."""
    return InputError(
        f"{path}: reading it takes more memory than there is; thin the clouds, "
        "take every so many-th frame (ingest.every) or free memory"
    )


def check_count(count: int, most: int) -> None:
    """Raise TooLargeError for more points than `most`."""
    if count > most:
        raise TooLargeError(count, most)


def too_large(path: Path, error: TooLargeError, limit: int) -> InputError:
    """The error for a sequence of more points than `limit`."""
    before = f" and {limit - error.most:,} in the frames before" if error.most < limit else ""
    return InputError(
        f"{path}: found {error.count:,} points{before}, expected at most {limit:,} in all frames (ingest.max_points); "
        "thin the clouds or raise the setting"
    )
