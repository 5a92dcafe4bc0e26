"""Surfaces of links as plain triangles, and points sampled on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int64

from schemas.errors import InputError
from stages.ingest.roboart.mesh_files import resolve_mesh
from stages.ingest.roboart.urdf import Robot, Shape, import_extra

Triangles = Float64[np.ndarray, "triangles 3 3"]


@dataclass(frozen=True)
class Surface:
    """Triangles in the frame of the part that each one moves with (metres)."""

    triangles: Triangles
    part: Int64[np.ndarray, "triangles"]


def sample_triangles(
    triangles: Triangles, count: int, rng: np.random.Generator
) -> tuple[Float64[np.ndarray, "points 3"], Int64[np.ndarray, "points"]]:
    """Points spread uniformly by area, and the triangle of each."""
    cumulative = np.cumsum(areas(triangles))
    chosen = np.searchsorted(cumulative[:-1], rng.uniform(0, cumulative[-1], count), side="right")
    # the root makes the image of the unit square uniform over the triangle
    u, v = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    a, b, c = np.moveaxis(triangles[chosen], 1, 0)
    return (1 - u) * a + u * (1 - v) * b + u * v * c, chosen


def areas(triangles: Triangles) -> Float64[np.ndarray, "triangles"]:
    """The area of each triangle."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def link_triangles(
    robot: Robot, top_link: Int64[np.ndarray, "links"], urdf_path: Path, mesh_dirs: Sequence[Path]
) -> list[Triangles]:
    """Each link's surface in its own frame, from its visual elements.

    Links of one `top_link` are rigidly joined. Where none of such a group has a visual, the collision
    elements stand in. (A collision element beside a visual one is a crude double of it: a cylinder
    round a motor, which nobody would see in a scan.) Raises InputError for a mesh that is missing or
    cannot be read.
    """

    @cache
    def mesh(reference: str) -> Triangles:
        return _read_mesh(resolve_mesh(reference, urdf_path, mesh_dirs))

    def triangles(shapes: tuple[Shape, ...]) -> Triangles:
        pieces = [move(shape.T_link_shape, _shape_triangles(shape.geometry, mesh, urdf_path)) for shape in shapes]
        return np.concatenate([np.empty((0, 3, 3)), *pieces])

    seen: Bool[np.ndarray, "links"] = np.zeros(len(robot.links), dtype=bool)
    seen[top_link[[len(shapes) > 0 for shapes in robot.visuals]]] = True
    return [
        triangles(robot.visuals[link] if seen[top_link[link]] else robot.collisions[link])
        for link in range(len(robot.links))
    ]


def _shape_triangles(geometry: Any, mesh: Callable[[str], Triangles], urdf_path: Path) -> Triangles:
    creation = import_extra("trimesh.creation")
    if geometry.mesh is not None:
        scale = 1.0 if geometry.mesh.scale is None else geometry.mesh.scale
        return mesh(geometry.mesh.filename) * scale
    if geometry.box is not None:
        made = creation.box(geometry.box.size)
    elif geometry.cylinder is not None:
        made = creation.cylinder(geometry.cylinder.radius, geometry.cylinder.length)
    elif geometry.sphere is not None:
        made = creation.icosphere(radius=geometry.sphere.radius)
    else:
        raise InputError(f"{urdf_path}: found an empty <geometry>, expected mesh, box, cylinder or sphere; correct it")
    return np.asarray(made.triangles, dtype=np.float64)


def _read_mesh(path: Path) -> Triangles:
    """A mesh file's triangles in metres. A .dae's up-axis is ignored, as in ROS: URDFs count on that."""
    trimesh = import_extra("trimesh")
    try:
        scene = trimesh.load_scene(str(path), skip_materials=True)
        if path.suffix.lower() == ".dae":
            scene = scene.convert_units("meters")
        triangles = np.asarray(scene.to_mesh().triangles, dtype=np.float64)
    except Exception as error:  # each format's reader has its own errors
        raise InputError(f"{path}: cannot be read as a mesh ({error!r}); restore that file") from error
    if len(triangles) == 0 or not np.isfinite(triangles).all():
        raise InputError(f"{path}: found no triangles or infinite ones, expected a surface mesh; restore that file")
    return _without_doubles(triangles)


def move(T: Float64[np.ndarray, "4 4"], triangles: Triangles) -> Triangles:
    return triangles @ T[:3, :3].T + T[:3, 3]


def _without_doubles(triangles: Triangles) -> Triangles:
    """Triangles that differ, whatever their winding: two-sided meshes hold each one twice."""
    corners = triangles.round(7)
    order = np.lexsort((corners[..., 2], corners[..., 1], corners[..., 0]), axis=-1)
    corners = np.take_along_axis(corners, order[..., None], axis=1)
    _, first = np.unique(corners.reshape(-1, 9), axis=0, return_index=True)
    return triangles[np.sort(first)]
