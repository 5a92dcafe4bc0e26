"""Non-rigid alignment of one cloud to another by a graph of rigid nodes (embedded deformation).

Nodes are spread over the source surface. Each has a rigid transform and moves the points near it, by distance along
the surface. Gauss-Newton minimises robust point-to-plane distances in both directions plus a stiffness term, by which
neighbouring nodes agree on each other's position.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.sparse import bsr_array, csr_array
from scipy.sparse.csgraph import dijkstra

from stages.kernels.alignment.registration import POINT_TO_POINT, sum_groups, turn_about, twist_jacobian
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import SURFACE_NEIGHBOURS, KDTree, nearest, neighbours
from stages.kernels.points.sampling import farthest_points

EDGE_REACH = 3.0  # robust reach of the stiffness, in spacing units: neighbours that differ by more may be at a joint
SOLVE_TOLERANCE, SOLVE_ITERATIONS = 1e-3, 200  # of the conjugate gradients in a Gauss-Newton step


@dataclass(frozen=True)
class DeformationGraph:
    """Nodes on a source cloud, and the nodes that move each point.

    `anchors` (points, k) are node indices, and the rows of `weights` (points, k) add up to one. `edges` (edges, 2) link
    nodes that move a common point, in both directions.
    """

    p_nodes: Float64[np.ndarray, "nodes 3"]
    anchors: Int64[np.ndarray, "points k"]
    weights: Float64[np.ndarray, "points k"]
    edges: Int64[np.ndarray, "edges 2"]


def build_graph(points: Float64[np.ndarray, "points 3"], nodes: int, neighbours_per_point: int) -> DeformationGraph:
    """Spread nodes over the cloud and attach each point to the nearest of them along the surface."""
    centres = farthest_points(points, nodes)
    distances = _surface_distances(points, centres)
    k = min(neighbours_per_point, len(centres))
    anchors = np.argsort(distances, axis=1, kind="stable")[:, :k]
    near = np.take_along_axis(distances, anchors, axis=1)
    radius = np.median(near[:, min(1, k - 1)]) + 1e-12
    weights = np.exp(-((near / radius) ** 2)) + 1e-12
    weights /= weights.sum(axis=1, keepdims=True)
    first, second = anchors[:, :, None].repeat(k, 2).ravel(), anchors[:, None, :].repeat(k, 1).ravel()
    pairs = np.unique(np.stack([first, second], axis=1)[first != second], axis=0)
    return DeformationGraph(points[centres], anchors, weights, pairs)


def _surface_distances(
    points: Float64[np.ndarray, "points 3"], centres: Int64[np.ndarray, "nodes"]
) -> Float64[np.ndarray, "points nodes"]:
    """Distances along the surface. Across gaps they are straight distances with a penalty."""
    lengths, indices = neighbours(points, SURFACE_NEIGHBOURS)
    rows = np.repeat(np.arange(len(points)), indices.shape[1])
    surface = csr_array((lengths.ravel() + 1e-12, (rows, indices.ravel())), shape=(len(points), len(points)))
    along = dijkstra(surface, directed=False, indices=centres).T
    straight = np.linalg.norm(points[:, None] - points[centres][None], axis=-1)
    return np.where(np.isfinite(along), along, 10.0 * straight + 10.0 * straight.max())


def deform(
    graph: DeformationGraph, Ts_target_node: Float64[np.ndarray, "nodes 4 4"], points: Float64[np.ndarray, "points 3"]
) -> Float64[np.ndarray, "points 3"]:
    """Move the source points by their nodes."""
    return np.einsum("nk,nki->ni", graph.weights, _moved_by_anchors(graph, Ts_target_node, points))


def _moved_by_anchors(
    graph: DeformationGraph, Ts: Float64[np.ndarray, "nodes 4 4"], points: Float64[np.ndarray, "points 3"]
) -> Float64[np.ndarray, "points k 3"]:
    anchored = Ts[graph.anchors]
    return np.einsum("nkij,nj->nki", anchored[..., :3, :3], points) + anchored[..., :3, 3]


class Alignment:
    """Gauss-Newton alignment of a source cloud's deformation graph to a target cloud.

    Internal lengths are in units of `spacing`, the clouds' spacing, so that stiffness and robustness do not depend on
    the sampling density.
    """

    def __init__(
        self,
        graph: DeformationGraph,
        source: Float64[np.ndarray, "points 3"],
        target: Float64[np.ndarray, "targets 3"],
        target_normals: Float64[np.ndarray, "targets 3"],
        spacing: float,
    ) -> None:
        self.graph, self.source, self.target = graph, source, target
        self.target_tree = KDTree(target)
        self.spacing = spacing
        # n n^T + POINT_TO_POINT I: the information that a match gives about a point's position
        self.target_information = np.einsum("ni,nj->nij", target_normals, target_normals)
        self.target_information += POINT_TO_POINT * np.eye(3)
        self._pattern = BlockPattern(graph.edges, len(graph.p_nodes))
        self._point_sums = self._pattern.sums(graph.anchors)
        self._edge_sums = self._pattern.sums(graph.edges)

    def matches(
        self, warped: Float64[np.ndarray, "points 3"]
    ) -> tuple[Int64[np.ndarray, "matches"], Int64[np.ndarray, "matches"], Float64[np.ndarray, "matches"]]:
        """Nearest-neighbour pairs (source, target, distance / spacing) in both directions."""
        forward_distance, forward = nearest(self.target_tree, warped)
        backward_distance, backward = nearest(KDTree(warped), self.target)
        source = np.concatenate([np.arange(len(warped)), backward])
        target = np.concatenate([forward, np.arange(len(self.target))])
        return source, target, np.concatenate([forward_distance, backward_distance]) / self.spacing

    def step(
        self, Ts: Float64[np.ndarray, "nodes 4 4"], stiffness: float, reach: float
    ) -> Float64[np.ndarray, "nodes 4 4"]:
        """Take one Gauss-Newton step. Matches much farther apart than `reach` (in spacing units) hardly count."""
        graph, nodes = self.graph, len(self.graph.p_nodes)
        centres = move_points(Ts, graph.p_nodes)
        moved = _moved_by_anchors(graph, Ts, self.source)
        warped = np.einsum("nk,nki->ni", graph.weights, moved)

        source, target, distance = self.matches(warped)
        robust = (1.0 / (1.0 + (distance / reach) ** 2)) ** 2
        information = robust[:, None, None] * self.target_information[target]
        offsets = (warped[source] - self.target[target]) / self.spacing
        pull = np.einsum("mij,mj->mi", information, offsets)
        information = sum_groups(information.reshape(-1, 9), source, len(warped)).reshape(-1, 3, 3)
        pull = sum_groups(pull, source, len(warped))

        # d(point)/d(twist of anchor k about its own centre) = w_k [-skew(p_k - c_k), I]
        arms = moved - centres[graph.anchors]
        jacobian = graph.weights[:, :, None, None] * twist_jacobian(arms / self.spacing)
        jacobian = jacobian.transpose(0, 2, 1, 3).reshape(len(warped), 3, -1)
        blocks = self._point_sums @ pair_blocks(jacobian, np.matmul(information, jacobian))
        gradient = _sum_twists(graph.anchors, np.matmul(pull[:, None], jacobian), nodes)

        # stiffness: a node's transform of its neighbour's centre, minus the neighbour's own
        k, neighbour = graph.edges.T
        predicted = move_points(Ts[k], graph.p_nodes[neighbour])
        gap = (predicted - centres[neighbour]) / self.spacing
        jacobian_k = twist_jacobian((predicted - centres[k]) / self.spacing)
        jacobian_neighbour = np.broadcast_to(-twist_jacobian(np.zeros((1, 3))), jacobian_k.shape)
        edge_jacobian = np.concatenate([jacobian_k, jacobian_neighbour], axis=2)
        edge_weight = stiffness / (1.0 + (gap**2).sum(-1) / EDGE_REACH**2) ** 2
        weighted = edge_weight[:, None, None] * edge_jacobian
        blocks += self._edge_sums @ pair_blocks(edge_jacobian, weighted)
        gradient += _sum_twists(graph.edges, np.matmul(gap[:, None], weighted), nodes)

        twists = -self._pattern.solve(blocks.reshape(-1, 6, 6), gradient)
        return turn_about(centres, twists, self.spacing) @ Ts

    def cost(self, Ts: Float64[np.ndarray, "nodes 4 4"], reach: float) -> float:
        """Mean robust squared distance in both directions, in squared spacings."""
        distance = self.matches(deform(self.graph, Ts, self.source))[2]
        return float(np.mean(distance**2 / (1.0 + (distance / reach) ** 2)))


class BlockPattern:
    """The filled 6 x 6 blocks of a graph's Hessian: the diagonal ones and one for each edge, row by row."""

    def __init__(self, edges: Int64[np.ndarray, "edges 2"], nodes: int) -> None:
        self.nodes = nodes
        diagonal = np.arange(nodes) * (nodes + 1)
        self._cells = np.sort(np.concatenate([diagonal, edges[:, 0] * nodes + edges[:, 1]]))
        self._columns = self._cells % nodes
        self._row_starts = np.searchsorted(self._cells, np.arange(nodes + 1) * nodes)
        self._diagonal = np.searchsorted(self._cells, diagonal)

    def sums(self, groups: Int64[np.ndarray, "rows k"]) -> csr_array:
        """The matrix (blocks, rows * k * k) that adds up each row's blocks over pairs of its k nodes."""
        cells = (groups[:, :, None] * self.nodes + groups[:, None, :]).ravel()
        entries = np.searchsorted(self._cells, cells)
        return csr_array((np.ones(len(cells)), (entries, np.arange(len(cells)))), shape=(len(self._cells), len(cells)))

    def solve(
        self, blocks: Float64[np.ndarray, "blocks 6 6"], gradient: Float64[np.ndarray, "nodes 6"]
    ) -> Float64[np.ndarray, "nodes 6"]:
        """Hessian^-1 gradient, by conjugate gradients preconditioned with the diagonal blocks."""
        axes = np.arange(6)
        diagonal = blocks[self._diagonal]
        diagonal[:, axes, axes] += 1e-6 * diagonal[:, axes, axes].max() + 1e-9
        blocks[self._diagonal] = diagonal
        hessian = bsr_array((blocks, self._columns, self._row_starts), shape=(6 * self.nodes, 6 * self.nodes))
        inverse = np.linalg.inv(diagonal)
        x, direction, residual = np.zeros(gradient.size), np.zeros(gradient.size), gradient.ravel()
        first, before = 0.0, np.inf
        for _ in range(SOLVE_ITERATIONS):
            preconditioned = np.matmul(inverse, residual.reshape(-1, 6, 1)).ravel()
            now = residual @ preconditioned
            first = first or now
            if now <= SOLVE_TOLERANCE**2 * first:
                break
            direction = preconditioned + (now / before) * direction
            product = hessian @ direction
            length = now / (direction @ product)
            x += length * direction
            residual = residual - length * product
            before = now
        return x.reshape(-1, 6)


def pair_blocks(
    left: Float64[np.ndarray, "rows 3 b"], right: Float64[np.ndarray, "rows 3 b"]
) -> Float64[np.ndarray, "pairs 36"]:
    """left^T right of each row, cut into 6 x 6 blocks over pairs of the row's nodes."""
    rows, k = len(left), left.shape[2] // 6
    products = np.matmul(left.transpose(0, 2, 1), right).reshape(rows, k, 6, k, 6)
    return products.transpose(0, 1, 3, 2, 4).reshape(-1, 36)


def _sum_twists(
    groups: Int64[np.ndarray, "rows k"], values: Float64[np.ndarray, "rows 1 b"], nodes: int
) -> Float64[np.ndarray, "nodes 6"]:
    return sum_groups(values.reshape(-1, 6), groups.ravel(), nodes)
