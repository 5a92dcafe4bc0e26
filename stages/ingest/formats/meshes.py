"""Meshes: .ply with faces, .obj, .stl, .gltf and .glb.

Only the file itself is read. Materials and pictures of an .obj lie in other files, so they are left out; those inside a
.glb give its points their colours. Units stay those of the file.
"""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np

from stages.ingest.formats.cloud import Cloud, as_colours
from stages.ingest.formats.gltf import read_gltf
from stages.ingest.formats.mesh_pieces import MeshSampling, Piece, sampled, vertices_of
from stages.ingest.formats.ply import ply_triangles, read_ply
from stages.ingest.messages import check_count

MESH_SUFFIXES = (".obj", ".stl", ".glb", ".gltf")  # beside .ply, which may hold points alone
_MOST_MIB = MeshSampling.max_mib
_LOOKED_AT = 1 << 16  # bytes


def read_mesh(path: Path, most: int, sampling: MeshSampling | None = None) -> Cloud:
    """Read a mesh's points: drawn from its surface by a `sampling`, or its vertices. A mesh without faces is a cloud.

    Raises ValueError or OSError for a file that is damaged, too large or refers to others, and TooLargeError for more
    than `most` vertices or triangles.
    """
    pieces = _pieces(path, most, _MOST_MIB if sampling is None else sampling.max_mib)
    count = sum(len(piece.vertices) for piece in pieces)
    if not count:
        raise ValueError("found neither triangles nor points")
    check_count(count, most)
    return vertices_of(pieces) if sampling is None else sampled(pieces, sampling)


def names_materials(path: Path) -> bool:
    """Whether an .obj names a file of materials near its beginning."""
    try:
        with path.open("rb") as file:
            return b"mtllib" in file.read(_LOOKED_AT)
    except OSError:
        return False


def _pieces(path: Path, most: int, max_mib: float) -> list[Piece]:
    suffix = path.suffix.lower()
    if suffix == ".ply":
        cloud = read_ply(path, most)
        return [Piece(cloud.points, ply_triangles(path, len(cloud.points), most), cloud.colours)]
    content = _content(path, int(max_mib * 2**20))
    return read_gltf(content) if suffix in (".glb", ".gltf") else _by_trimesh(content, suffix)


def _content(path: Path, most: int) -> bytes:
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ValueError(
            f"found a file of more than {most / 2**20:g} MiB, expected at most that (ingest.mesh.max_mib); "
            "simplify it or raise the setting"
        )
    return content


def _by_trimesh(content: bytes, suffix: str) -> list[Piece]:
    import trimesh

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # it logs whole tracebacks, and also raises the errors
    try:
        with np.errstate(all="ignore"):
            scene = trimesh.load_scene(  # given bytes, it can read no other file
                io.BytesIO(content), file_type=suffix[1:], process=False, skip_materials=True
            )
            return [_piece(geometry) for geometry in scene.geometry.values() if hasattr(geometry, "visual")]
    except MemoryError:
        raise
    except Exception as error:  # each format's reader raises its own errors
        raise ValueError(f"cannot be read as a mesh ({error!r:.200})") from error


def _piece(geometry: Any) -> Piece:
    """A mesh or a cloud of points of trimesh."""
    vertices = np.asarray(geometry.vertices, dtype=np.float64).reshape(-1, 3)
    triangles = np.asarray(getattr(geometry, "faces", ()), dtype=np.int64).reshape(-1, 3)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise ValueError(f"found a face of vertices {triangles.min()} to {triangles.max()}, there are {len(vertices)}")
    visual, colours = geometry.visual, None
    if visual.kind == "vertex":
        colours = np.asarray(visual.vertex_colors)
    elif visual.kind == "texture":
        colours = visual.vertex_attributes.get("color")
    if colours is None or len(colours) != len(vertices):
        return Piece(vertices, triangles)
    return Piece(vertices, triangles, as_colours(np.asarray(colours)[:, :3]))
