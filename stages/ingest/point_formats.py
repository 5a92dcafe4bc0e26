"""Reading of one file of points, in any format."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from schemas.errors import InputError
from stages.ingest.formats.arrays import read_npy, read_organised
from stages.ingest.formats.disguises import disguise
from stages.ingest.formats.npz_frames import read_one_cloud
from stages.ingest.formats.pcd import read_pcd
from stages.ingest.formats.ply import read_ply
from stages.ingest.formats.rows import Points
from stages.ingest.formats.tables import read_table
from stages.ingest.messages import TooLargeError, one_line, out_of_memory, unreadable

_READERS: dict[str, Callable[[Path, int], Points]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".xyz": read_table,
    ".npy": read_npy,
    ".pts": read_table,
    ".asc": read_table,
    ".csv": read_table,
    ".tsv": read_table,
    ".txt": read_table,
    ".npz": read_one_cloud,
}
FRAME_SUFFIXES = tuple(_READERS)
# such files may hold other things, so they are frames only if they look like it and there are no others
AMBIGUOUS_SUFFIXES = (".pts", ".asc", ".csv", ".tsv", ".txt", ".npz")


def read_points(path: Path, most: int = sys.maxsize, organised: bool = False) -> Points:
    """Read the coordinates in one file, including NaN and infinity.

    Normals, colours, faces and other columns are ignored. `organised` allows a .npy of rows and columns. Raises
    TooLargeError for more than `most` points, if possible before they are read, and InputError for a file that is
    damaged, truncated or of another kind.
    """
    suffix = path.suffix.lower()
    try:
        return read_organised(path, most) if organised else _READERS[suffix](path, most)
    except TooLargeError:
        raise
    except MemoryError as error:
        raise out_of_memory(path) from error
    except OSError as error:
        raise unreadable(path, error) from error
    except (ValueError, OverflowError, TypeError) as error:
        reason = disguise(path) or one_line(error)
        advice = "" if "; " in reason else f"; export it again as a whole {suffix} file of points with x, y and z"
        raise InputError(f"{path}: {reason}{advice}") from error
