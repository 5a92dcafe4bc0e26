"""Mesh files as plain triangles, with bounds on their size."""

from __future__ import annotations

import io
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from schemas.errors import InputError, quoted
from stages.ingest.roboart.collada_check import check_collada
from stages.ingest.roboart.urdf import import_extra
from stages.ingest.roboart.urdf_check import GREATEST_METRES

Triangles = Float64[np.ndarray, "triangles 3 3"]

FORMATS = (".stl", ".obj", ".dae", ".ply")  # other formats are archives, or refer to further files
PLY_ELEMENT = re.compile(rb"^element\s+\S+\s+(\d+)", re.MULTILINE)
PLY_HEADER_END = b"end_header"


def read_mesh(path: Path, reference: str, urdf_path: Path, max_mib: float) -> Triangles:
    """Read a mesh file's triangles in metres. Only this file is read, without textures and materials.

    A .dae's up-axis is ignored, as in ROS, since URDFs rely on that. Raises InputError, which names the URDF and the
    mesh, for another format, for more than `max_mib`, and for a file that cannot be read or has no finite triangles.
    """
    where = f"{urdf_path}: mesh {quoted(reference)}"
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{where}: found {suffix or 'no suffix'}, expected one of {', '.join(FORMATS)}; convert it")
    most = int(max_mib * 2**20)
    content = _content(path, most, where)
    trimesh = import_extra("trimesh")
    try:
        if suffix == ".dae":
            check_collada(content, most)
        if suffix == ".ply":
            _check_ply(content)
        triangles = _triangles(trimesh, content, suffix)
    except Exception as error:  # each format's reader raises its own errors
        raise InputError(f"{where}: {path} cannot be read as a mesh ({error!r:.300}); restore that file") from error
    if triangles.size == 0:
        raise InputError(f"{where}: found no triangles in {path}, expected a surface mesh; restore that file")
    return _without_doubles(triangles)


def _content(path: Path, most: int, where: str) -> bytes:
    """Read a file's bytes. Raises InputError if it cannot be read, or has more than `most`."""
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)
    except OSError as error:
        raise InputError(f"{where}: {path} cannot be read ({error.strerror}); check its permissions") from error
    if len(content) > most:
        raise InputError(
            f"{where}: found a file of more than {most / 2**20:g} MiB, expected at most that; "
            "simplify it, or raise ingest.roboart.max_mesh_mib"
        )
    return content


def _check_ply(content: bytes) -> None:
    """Raise ValueError if the header declares more elements than the file has bytes."""
    header = content.partition(PLY_HEADER_END)[0]
    for count in map(int, PLY_ELEMENT.findall(header)):
        if count > len(content):
            raise ValueError(f"found {count} elements declared in a file of {len(content)} bytes")


def _triangles(trimesh: Any, content: bytes, suffix: str) -> Triangles:
    """Read the triangles by trimesh. It silently drops numbers that are not finite, so they are checked first."""
    file_type = suffix.removeprefix(".")
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # it logs whole tracebacks, and also raises the errors
    with np.errstate(all="ignore"):
        scene = trimesh.load_scene(io.BytesIO(content), file_type=file_type, skip_materials=True, process=False)
        for geometry in scene.geometry.values():
            _check_numbers(geometry.vertices)
            if hasattr(geometry, "process"):
                geometry.process()
        if suffix == ".dae":
            scene = scene.convert_units("meters")
        triangles = np.asarray(scene.to_mesh().triangles, dtype=np.float64)
    _check_numbers(triangles)
    if triangles.size and triangles.shape[1:] != (3, 3):
        raise ValueError("found faces that are no triangles in space")
    return triangles


def _check_numbers(p: np.ndarray) -> None:
    if p.size and not np.abs(p).max() <= GREATEST_METRES:
        raise ValueError(f"found NaN, infinity or numbers beyond {GREATEST_METRES:g}, expected coordinates")


def _without_doubles(triangles: Triangles) -> Triangles:
    """Remove repeated triangles, of any winding, since two-sided meshes hold each one twice."""
    corners = triangles.round(7)
    order = np.lexsort((corners[..., 2], corners[..., 1], corners[..., 0]), axis=-1)
    corners = np.take_along_axis(corners, order[..., None], axis=1)
    _, first = np.unique(corners.reshape(-1, 9), axis=0, return_index=True)
    return triangles[np.sort(first)]
