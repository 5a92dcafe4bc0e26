"""The triangles of a surface whose vertices are the points of each frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int64

from schemas.errors import InputError
from stages.ingest.formats.arrays import load_npz
from stages.ingest.formats.ply import ply_triangles
from stages.ingest.messages import one_line

FACES = "faces"
_MOST_PER_VERTEX = 4  # a closed surface has about two triangles per vertex


def file_triangles(path: Path, vertices: int, most: int) -> Int64[np.ndarray, "triangles 3"] | None:
    """Read the triangles of a .ply, or the array `faces` of an .npz; None if there are none.

    Raises InputError for triangles that do not fit the number of `vertices`, and for more than `most`.
    """
    if path.suffix.lower() == ".ply":
        return _ply_triangles(path, vertices, most)
    if path.suffix.lower() != ".npz":
        return None
    faces = load_npz(path, (FACES,), 8 * 3 * min(most, _MOST_PER_VERTEX * vertices + 1000)).get(FACES)
    return None if faces is None else checked_triangles(faces, vertices, f"{path}: {FACES}")


def checked_triangles(faces: Any, vertices: int, where: str) -> Int64[np.ndarray, "triangles 3"]:
    """Check an array of triangles. Raises InputError, naming `where`, for a wrong shape or vertices out of range."""
    if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces) or faces.dtype.kind not in "iuf":
        raise InputError(
            f"{where}: found shape {faces.shape} of {faces.dtype}, expected (triangles, 3) of integers; correct them"
        )
    if not (
        np.isfinite(faces).all() and (faces == np.floor(faces)).all() and 0 <= faces.min() <= faces.max() < vertices
    ):
        raise InputError(
            f"{where}: found values in {faces.min()}..{faces.max()}, expected whole numbers in 0..{vertices - 1}, "
            "the numbers of the vertices; correct them"
        )
    return faces.astype(np.int64)


def _ply_triangles(file: Path, vertices: int, most: int) -> Int64[np.ndarray, "triangles 3"] | None:
    try:
        triangles = ply_triangles(file, vertices, most)
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: faces: {one_line(error)}; write the file anew") from error
    return triangles if len(triangles) else None
