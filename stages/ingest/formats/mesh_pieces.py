"""Pieces of meshes, and the points that stand for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64, UInt8

from schemas.artifact import GREATEST
from stages.ingest.formats.cloud import Cloud, Colours
from stages.kernels.surfaces.area_sampling import areas, draw_on_triangles, on_triangles

MOST = 20_000_000  # vertices of a file, or corners of its triangles, however often it repeats them: about 1 GB


@dataclass(frozen=True)
class MeshSampling:
    """How a mesh becomes points: so many, drawn uniformly by area. Files beyond `max_mib` are refused."""

    points: int
    rng: np.random.Generator
    max_mib: float = 256.0


@dataclass(frozen=True)
class Piece:
    """Vertices, and triangles of them (none in a cloud). Colours of the vertices, a picture and a tint are multiplied.

    `uv` is the place of each vertex in the picture, from its upper left corner; `tint` is red, green and blue up to 1.
    """

    vertices: Float64[np.ndarray, "vertices 3"]
    triangles: Int64[np.ndarray, "triangles 3"]
    colours: Colours | None = None
    picture: UInt8[np.ndarray, "rows columns 3"] | None = None
    uv: Float64[np.ndarray, "vertices 2"] | None = None
    tint: Float64[np.ndarray, "3"] | None = None

    @property
    def coloured(self) -> bool:
        return not (self.colours is None and self.picture is None and self.tint is None)

    def colours_at(self, corners: Int64[np.ndarray, "points 3"], weights: Float64[np.ndarray, "points 3"]) -> Colours:
        """The colours of points between three vertices each. A piece without colours is white."""
        colours = np.full((len(corners), 3), 255.0)
        if self.picture is not None and self.uv is not None:
            rows, columns, _ = self.picture.shape
            u, v = np.nan_to_num(on_triangles(self.uv[corners], weights)).T % 1.0
            row, column = np.minimum(v * rows, rows - 1), np.minimum(u * columns, columns - 1)
            colours = self.picture[row.astype(np.int64), column.astype(np.int64)].astype(np.float64)
        if self.colours is not None:
            colours = colours * on_triangles(self.colours[corners] / 255.0, weights)
        if self.tint is not None:
            colours = colours * self.tint
        return np.rint(colours.clip(0, 255)).astype(np.uint8)


def sampled(pieces: list[Piece], sampling: MeshSampling) -> Cloud:
    """Draw points uniformly by area from the triangles of all pieces; without any, take the vertices.

    Raises ValueError for coordinates that are no numbers, and for triangles without an area.
    """
    if not any(len(piece.triangles) for piece in pieces):
        return vertices_of(pieces)
    corners = np.concatenate([piece.vertices[piece.triangles] for piece in pieces])
    if not (np.abs(corners) < GREATEST).all():
        raise ValueError("found NaN, infinity or huge numbers among the vertices, expected coordinates; correct them")
    if not areas(corners).sum() > 0:
        raise ValueError("found triangles without an area, expected a surface; check how it was written")
    chosen, weights = draw_on_triangles(corners, sampling.points, sampling.rng)
    points = on_triangles(corners[chosen], weights)
    if not any(piece.coloured for piece in pieces):
        return Cloud(points)
    colours = np.empty((len(points), 3), dtype=np.uint8)
    ends = np.cumsum([len(piece.triangles) for piece in pieces])
    for piece, end in zip(pieces, ends, strict=True):
        first = end - len(piece.triangles)
        here = (chosen >= first) & (chosen < end)
        colours[here] = piece.colours_at(piece.triangles[chosen[here] - first], weights[here])
    return Cloud(points, colours)


def vertices_of(pieces: list[Piece]) -> Cloud:
    """The vertices of all pieces, with their colours if any piece has some."""
    points = np.concatenate([np.zeros((0, 3)), *(piece.vertices for piece in pieces)])
    if not any(piece.coloured for piece in pieces):
        return Cloud(points)
    return Cloud(points, np.concatenate([_vertex_colours(piece) for piece in pieces]))


def _vertex_colours(piece: Piece) -> Colours:
    index = np.arange(len(piece.vertices))
    return piece.colours_at(np.stack([index] * 3, axis=1), np.tile([1.0, 0.0, 0.0], (len(index), 1)))
