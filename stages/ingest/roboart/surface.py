"""Surfaces of links as plain triangles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int64

from schemas.errors import InputError, quoted
from stages.ingest.roboart.mesh_files import resolve_mesh
from stages.ingest.roboart.mesh_reading import Triangles, read_mesh
from stages.ingest.roboart.urdf import Robot, import_extra
from stages.ingest.roboart.urdf_check import GREATEST_METRES
from stages.kernels.surfaces.area_sampling import areas, sample_triangles

__all__ = ["MOST_TRIANGLES", "Surface", "areas", "link_triangles", "move", "sample_triangles"]

MOST_TRIANGLES = 20_000_000  # of a whole description: 1.4 GB


@dataclass(frozen=True)
class Surface:
    """Triangles (metres), each in the frame of its part."""

    triangles: Triangles
    part: Int64[np.ndarray, "triangles"]


def link_triangles(
    robot: Robot,
    top_link: Int64[np.ndarray, "links"],
    urdf_path: Path,
    mesh_dirs: Sequence[Path],
    max_mesh_mib: float,
) -> list[Triangles]:
    """Each link's surface in its own frame, from its visual elements.

    Links with the same `top_link` form a rigid group. If no link of a group has a visual element, its collision
    elements are used. Otherwise these are only crude copies of the visual ones, which no scan would show.

    Raises InputError for a mesh that is missing, unreadable or larger than `max_mesh_mib`, for a shape without surface,
    and for too many triangles.
    """

    total = 0

    @cache
    def mesh(reference: str) -> Triangles:
        return read_mesh(resolve_mesh(reference, urdf_path, mesh_dirs), reference, urdf_path, max_mesh_mib)

    def triangles(link: int) -> Triangles:
        nonlocal total
        pieces = [np.empty((0, 3, 3))]
        for shape in robot.visuals[link] if seen[top_link[link]] else robot.collisions[link]:
            made = _shape_triangles(shape.geometry, mesh, f"{urdf_path}: link {quoted(robot.links[link])}")
            pieces.append(move(shape.T_link_shape, made))
            total += len(made)
            if total > MOST_TRIANGLES:
                raise InputError(
                    f"{urdf_path}: link {quoted(robot.links[link])}: found more than {MOST_TRIANGLES:,} triangles in "
                    "all links up to this, expected fewer; simplify the meshes, or name each of them less often"
                )
        return np.concatenate(pieces)

    seen: Bool[np.ndarray, "links"] = np.zeros(len(robot.links), dtype=bool)
    seen[top_link[[len(shapes) > 0 for shapes in robot.visuals]]] = True
    return [triangles(link) for link in range(len(robot.links))]


def _shape_triangles(geometry: Any, mesh: Callable[[str], Triangles], where: str) -> Triangles:
    """A shape's surface in its own frame. Raises InputError if it is empty, or not of the size of a real object."""
    name, sizes, made = _made(geometry, mesh)
    if name != "mesh" and np.min(sizes) < 0:
        raise InputError(f"{where}: found a <{name}> of size {sizes}, expected none below zero; correct the URDF")
    if not 0 < areas(made).sum() < np.inf or np.abs(made).max() > GREATEST_METRES:
        raise InputError(
            f"{where}: found a <{name}> of size {sizes} with no surface or one beyond {GREATEST_METRES:g} m, "
            "expected one that can be seen; correct the URDF"
        )
    return made


def _made(geometry: Any, mesh: Callable[[str], Triangles]) -> tuple[str, Any, Triangles]:
    """The name of the shape's element, its sizes (a mesh's scale), and its triangles."""
    creation = import_extra("trimesh.creation")
    if geometry.mesh is not None:
        scale = 1.0 if geometry.mesh.scale is None else geometry.mesh.scale
        return "mesh", scale, mesh(geometry.mesh.filename) * scale
    if geometry.box is not None:
        name, sizes = "box", tuple(geometry.box.size.tolist())
        made = creation.box(geometry.box.size)
    elif geometry.cylinder is not None:
        name, sizes = "cylinder", (geometry.cylinder.radius, geometry.cylinder.length)
        made = creation.cylinder(*sizes)
    else:
        name, sizes = "sphere", (geometry.sphere.radius,)
        made = creation.icosphere(radius=geometry.sphere.radius)
    return name, sizes, np.asarray(made.triangles, dtype=np.float64)


def move(T: Float64[np.ndarray, "4 4"], triangles: Triangles) -> Triangles:
    return triangles @ T[:3, :3].T + T[:3, 3]
