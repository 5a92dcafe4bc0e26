import numpy as np
import pytest

from stages.flow.deformation_graph import Alignment, BlockPattern, build_graph, deform, pair_blocks
from stages.kernels.kinematics.tree import joint_transforms
from stages.kernels.points.sampling import normals, point_spacing


def bumpy_sheet(seed, count=600):
    xy = np.random.default_rng(seed).uniform(-1, 1, size=(count, 2))
    return np.column_stack([xy, 0.3 * np.sin(3 * xy[:, 0]) * np.cos(2 * xy[:, 1])])


@pytest.fixture(scope="module")
def graph():
    return build_graph(bumpy_sheet(0), 40, 4)


def test_weights_add_up_and_edges_go_both_ways(graph):
    np.testing.assert_allclose(graph.weights.sum(axis=1), 1)
    edges = {tuple(edge) for edge in graph.edges}
    assert all((b, a) in edges for a, b in edges)


def test_one_rigid_motion_of_all_nodes_moves_points_rigidly(graph):
    T = joint_transforms(np.zeros(3), np.array([0.3, -0.2, 0.5, 1.0, 2.0, 3.0]))
    p = bumpy_sheet(0)
    moved = deform(graph, np.tile(T, (len(graph.p_nodes), 1, 1)), p)
    np.testing.assert_allclose(moved, p @ T[:3, :3].T + T[:3, 3], atol=1e-12)


def test_aligns_to_an_independent_sample_of_a_moved_surface(graph):
    T = joint_transforms(np.zeros(3), np.array([0.1, 0.05, 0.1, 0.05, -0.05, 0.05]))
    target = bumpy_sheet(1) @ T[:3, :3].T + T[:3, 3]
    source = bumpy_sheet(0)
    alignment = Alignment(graph, source, target, normals(target), point_spacing(target))
    Ts = np.tile(np.eye(4), (len(graph.p_nodes), 1, 1))
    before = alignment.cost(Ts, 3.0)
    for stiffness in (30.0, 10.0, 3.0):
        for _ in range(8):
            Ts = alignment.step(Ts, stiffness, 8.0)
    assert alignment.cost(Ts, 3.0) < 0.5 * before
    error = np.linalg.norm(deform(graph, Ts, source) - (source @ T[:3, :3].T + T[:3, 3]), axis=1)
    assert error.mean() < point_spacing(target)


def test_limbs_that_are_close_but_not_connected_have_nodes_of_their_own():
    blade = np.column_stack([np.random.default_rng(2).uniform(0, 1, size=(300, 2)), np.zeros(300)])
    both = np.concatenate([blade, blade + [0, 0, 0.3]])
    graph = build_graph(both, 30, 4)
    upper_nodes = graph.p_nodes[:, 2] > 0.15
    upper_points = both[:, 2] > 0.15
    assert (upper_nodes[graph.anchors] == upper_points[:, None]).all()


def test_the_block_solver_agrees_with_a_dense_one(graph):
    rng, nodes = np.random.default_rng(3), len(graph.p_nodes)
    pattern = BlockPattern(graph.edges, nodes)
    left = rng.normal(size=(len(graph.anchors), 3, 24))
    products = np.matmul(left.transpose(0, 2, 1), left)
    unknowns = (6 * graph.anchors[:, :, None] + np.arange(6)).reshape(len(left), -1)
    dense = np.zeros((6 * nodes, 6 * nodes))
    np.add.at(dense, (unknowns[:, :, None], unknowns[:, None, :]), products)
    x = rng.normal(size=6 * nodes)
    blocks = (pattern.sums(graph.anchors) @ pair_blocks(left, left)).reshape(-1, 6, 6)
    solved = pattern.solve(blocks, (dense @ x).reshape(-1, 6)).ravel()
    assert np.linalg.norm(solved - x) < 0.05 * np.linalg.norm(x)


def test_a_zero_gradient_is_solved_by_standing_still(graph):
    pattern = BlockPattern(graph.edges, len(graph.p_nodes))
    blocks = pattern.sums(graph.edges) @ np.tile(np.eye(6).ravel(), (4 * len(graph.edges), 1))
    np.testing.assert_array_equal(pattern.solve(blocks.reshape(-1, 6, 6), np.zeros((len(graph.p_nodes), 6))), 0)


def test_a_joint_costs_less_stiffness_the_farther_it_opens(graph):
    """The pull across a gap grows less than the gap itself."""
    p, right = graph.p_nodes, graph.p_nodes[:, 0] > 0

    def pull(gap):
        Ts = np.tile(np.eye(4), (len(p), 1, 1))
        Ts[right, 0, 3] = gap
        # the target is where the source has been moved to: only stiffness pulls
        target = deform(graph, Ts, bumpy_sheet(0))
        alignment = Alignment(graph, bumpy_sheet(0), target, normals(target), point_spacing(target))
        return np.linalg.norm((alignment.step(Ts, 3.0, 4.0) - Ts)[:, :3, 3])

    assert pull(0.8) < pull(0.1)
