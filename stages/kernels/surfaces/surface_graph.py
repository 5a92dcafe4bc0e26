"""The neighbourhood graph of a cloud: which points lie next to each other on its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from stages.kernels.points.nearest import FEW_NEIGHBOURS, neighbours
from stages.kernels.points.sampling import normals, point_spacing

CREASE, LEAST_WEIGHT = 0.1, 0.1  # 1 - |cos| of the angle between normals at which a weight has fallen to 1/e; its floor
LONGEST_EDGE = 6.0  # longer edges, in spacings, bridge gaps between surfaces


@dataclass(frozen=True)
class SurfaceGraph:
    """Undirected edges between neighbouring points, each once, and their lengths."""

    points: int
    edges: Int64[np.ndarray, "edges 2"]
    lengths: Float64[np.ndarray, "edges"]

    def adjacency(self, weights: np.ndarray, kept: Bool[np.ndarray, "edges"] | slice = slice(None)) -> csr_array:
        """The symmetric sparse matrix of some edges."""
        a, b = self.edges[kept].T
        w = weights[kept]
        shape = (self.points, self.points)
        return csr_array((np.concatenate([w, w]), (np.concatenate([a, b]), np.concatenate([b, a]))), shape=shape)

    def distances(self, seeds: Int64[np.ndarray, "seeds"], limit: float) -> Float64[np.ndarray, "seeds points"]:
        """Distances along the surface from each seed; infinite beyond `limit`."""
        return dijkstra(self.adjacency(self.lengths + 1e-12), directed=False, indices=seeds, limit=limit)

    def crossings(
        self, labels: Int64[np.ndarray, "points"]
    ) -> tuple[Int64[np.ndarray, "pairs 2"], Int64[np.ndarray, "pairs"]]:
        """Pairs of labels, smaller first, that share edges, and how many."""
        pairs = np.sort(labels[self.edges], axis=1)
        return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0, return_counts=True)

    def components(self, labels: Int64[np.ndarray, "points"]) -> Int64[np.ndarray, "points"]:
        """The connected piece of one label that each point belongs to."""
        a, b = self.edges.T
        same = labels[a] == labels[b]
        return connected_components(self.adjacency(np.ones(len(self.edges)), same), directed=False)[1]


def smoothness_weights(
    points: Float64[np.ndarray, "points 3"], graph: SurfaceGraph, normal_neighbours: int = 12
) -> Float64[np.ndarray, "edges"]:
    """How little the surface bends along each edge: near one where it is flat, small at creases; one in the mean.

    Parts of a thing usually meet at creases, and surfaces that cross are not one.
    """
    n = normals(points, normal_neighbours)
    a, b = graph.edges.T
    bend = 1.0 - np.abs(np.einsum("ni,ni->n", n[a], n[b]))
    weights = LEAST_WEIGHT + (1.0 - LEAST_WEIGHT) * np.exp(-bend / CREASE)
    return weights / weights.mean() if len(weights) else weights


def surface_graph(points: Float64[np.ndarray, "points 3"], count: int = FEW_NEIGHBOURS) -> SurfaceGraph:
    """Each point linked to its `count` nearest others, but for links that bridge gaps."""
    indices = neighbours(points, count)[1]
    ends = np.stack([np.arange(len(points)).repeat(indices.shape[1]), indices.ravel()], axis=1)
    edges = np.unique(np.sort(ends, axis=1), axis=0)
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    short = (edges[:, 0] != edges[:, 1]) & (lengths < LONGEST_EDGE * point_spacing(points))
    return SurfaceGraph(len(points), edges[short], lengths[short])
