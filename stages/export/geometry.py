"""The shape of every part, from the points of all frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64, UInt8

from schemas.config import ExportConfig
from schemas.errors import InputError
from schemas.model_file import Result
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import SURFACE_NEIGHBOURS, KDTree, nearest
from stages.kernels.points.sampling import point_spacing
from stages.kernels.surfaces.meshing import Mesh, closed_surface, convex_hull, decimated, smoothed, without_outliers
from stages.kernels.surfaces.surface_graph import surface_graph
from stages.support.open3d_use import needing_open3d

LEAST_SPECK = 0.02  # a separate piece with a smaller share of a part's points is dropped
COACD_TRIANGLES = 600
COLOURED_BY = 4  # points that give a vertex its colour
MOST_POINTS = 150_000  # in a whole description; more points are thinned evenly


@dataclass(frozen=True)
class Fused:
    """The points of all frames in the canonical frame's coordinates, their parts, and their colours if known."""

    points: Float64[np.ndarray, "fused 3"]
    labels: Int64[np.ndarray, "fused"]
    colours: UInt8[np.ndarray, "fused 3"] | None = None


def fuse(
    result: Result,
    frames: Sequence[Float64[np.ndarray, "_ 3"]] | None,
    farthest: float,
    colours: Sequence[UInt8[np.ndarray, "_ 3"]] | None = None,
) -> Fused:
    """Fuse the points of all frames, which have `colours` if given.

    A point of another frame belongs to the part of the nearest canonical point, posed in that frame. Points farther
    than `farthest` spacings from it are left out.
    """
    p = result.canonical_points.astype(np.float64)
    clouds, labels = [p], [result.labels]
    painted = [] if result.colours is None else [result.colours]
    reach = farthest * point_spacing(p)
    for t, frame in enumerate(frames or ()):
        if t == result.model.canonical_frame:
            continue
        Ts = result.T_frame_canonical[t]
        distance, index = nearest(KDTree(move_points(Ts[result.labels], p)), frame)
        here, close = result.labels[index], distance <= reach
        clouds.append(move_points(np.linalg.inv(Ts)[here[close]], frame[close]))
        labels.append(here[close])
        if colours is not None:
            painted.append(colours[t][close])
    fused = np.concatenate(clouds)
    thinned = slice(None, None, -(-len(fused) // MOST_POINTS))
    known = len(painted) == len(clouds)
    return Fused(fused[thinned], np.concatenate(labels)[thinned], np.concatenate(painted)[thinned] if known else None)


def vertex_colours(
    vertices: Float64[np.ndarray, "vertices 3"],
    points: Float64[np.ndarray, "points 3"],
    colours: UInt8[np.ndarray, "points 3"],
) -> UInt8[np.ndarray, "vertices 3"]:
    """The mean colour of the points nearest to each vertex."""
    count = min(COLOURED_BY, len(points))
    near = KDTree(points).query(np.ascontiguousarray(vertices), k=count)[1].reshape(len(vertices), count)
    return np.rint(colours[near].mean(axis=1)).astype(np.uint8)


def cleaned(points: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "kept 3"]:
    """Clean a part's points: remove duplicates, outliers and specks, and smooth the noise."""
    points = np.unique(points, axis=0)
    if len(points) <= SURFACE_NEIGHBOURS:
        return points
    points = points[without_outliers(points)]
    graph = surface_graph(points, SURFACE_NEIGHBOURS)
    piece = graph.components(np.zeros(len(points), dtype=np.int64))
    sizes = np.bincount(piece)
    return smoothed(points[sizes[piece] >= min(LEAST_SPECK * len(points), sizes.max())])


@needing_open3d("meshes of parts")
def part_mesh(points: Float64[np.ndarray, "points 3"], least_radius: float, config: ExportConfig) -> Mesh:
    """The surface of a part's cleaned points. A single point becomes a small ball, a flat part a slab."""
    radius = max(config.reach * point_spacing(points), least_radius) if len(points) > 1 else least_radius
    mesh = closed_surface(points, radius)
    return decimated(convex_hull(mesh.vertices) if config.surface == "hull" else mesh, config.triangles)


@needing_open3d("meshes of parts")
def collision_meshes(mesh: Mesh, config: ExportConfig) -> list[Mesh]:
    """Convex meshes that represent a part in contacts. Raises InputError if coacd is requested but not installed."""
    if config.collision == "hull":
        return [convex_hull(mesh.vertices)]
    try:
        import coacd
    except ImportError as error:
        raise InputError(
            "collision coacd: found that the package is not installed; `pip install rearticulate[coacd]`, or take hull"
        ) from error
    coacd.set_log_level("error")
    coarse = decimated(mesh, COACD_TRIANGLES)  # else coacd takes minutes for each part
    pieces = coacd.run_coacd(
        coacd.Mesh(coarse.vertices, coarse.triangles),
        threshold=0.1,
        mcts_iterations=30,
        max_convex_hull=16,
        preprocess_mode="off",
        seed=0,
    )
    return [convex_hull(np.asarray(vertices, dtype=np.float64)) for vertices, _ in pieces]
