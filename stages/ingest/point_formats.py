"""Reading of one file of points or of a mesh, in any format."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from schemas.errors import InputError
from stages.ingest.formats.arrays import read_npy, read_organised
from stages.ingest.formats.cloud import Cloud
from stages.ingest.formats.disguises import disguise
from stages.ingest.formats.mesh_pieces import MeshSampling
from stages.ingest.formats.meshes import MESH_SUFFIXES, read_mesh
from stages.ingest.formats.npz_frames import read_one_cloud
from stages.ingest.formats.pcd import read_pcd
from stages.ingest.formats.ply import read_ply
from stages.ingest.formats.scanners import read_e57, read_las
from stages.ingest.formats.tables import read_table
from stages.ingest.messages import TooLargeError, one_line, out_of_memory, unreadable

_READERS: dict[str, Callable[[Path, int], Cloud]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".xyz": read_table,
    ".xyzrgb": read_table,
    ".npy": read_npy,
    ".e57": read_e57,
    ".las": read_las,
    ".laz": read_las,
    ".pts": read_table,
    ".asc": read_table,
    ".csv": read_table,
    ".tsv": read_table,
    ".txt": read_table,
    ".npz": read_one_cloud,
}
FRAME_SUFFIXES = (*_READERS, *MESH_SUFFIXES)
# such files may hold other things, so they are frames only if they look like it and there are no others
AMBIGUOUS_SUFFIXES = (".pts", ".asc", ".csv", ".tsv", ".txt", ".npz")


def read_cloud(
    path: Path, most: int = sys.maxsize, organised: bool = False, sampling: MeshSampling | None = None
) -> Cloud:
    """Read the points in one file, including NaN and infinity, and their colours.

    Normals and other columns are ignored. A mesh's surface is sampled if there is a `sampling`; else its vertices are
    taken. `organised` allows a .npy of rows and columns. Raises TooLargeError for more than `most` points, if possible
    before they are read, and InputError for a file that is damaged, truncated or of another kind.
    """
    suffix = path.suffix.lower()
    try:
        if organised:
            return read_organised(path, most)
        if suffix in MESH_SUFFIXES or (suffix == ".ply" and sampling is not None):
            return read_mesh(path, most, sampling)
        return _READERS[suffix](path, most)
    except TooLargeError:
        raise
    except MemoryError as error:
        raise out_of_memory(path) from error
    except OSError as error:
        raise unreadable(path, error) from error
    except (ValueError, OverflowError, TypeError) as error:
        reason = disguise(path) or one_line(error)
        kind = "a mesh" if suffix in MESH_SUFFIXES else "points with x, y and z"
        advice = "" if "; " in reason else f"; export it again as a whole {suffix} file of {kind}"
        raise InputError(f"{path}: {reason}{advice}") from error
