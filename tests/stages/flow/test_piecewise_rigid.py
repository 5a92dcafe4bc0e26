import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stages.flow.deformation_graph import build_graph
from stages.flow.piecewise_rigid import Nodes, Surface, piecewise_rigid, suggested_motions
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import point_spacing

T_LID = np.eye(4)
T_LID[:3, :3] = Rotation.from_rotvec([0.0, 2.0, 0.0]).as_matrix()
T_LID[:3, 3] = [0.1, 0.0, 0.2]


@pytest.fixture
def clouds(hinge):
    """A box with its lid, the same sampled anew with the lid turned far, labels and true places of the first."""
    (before, after), labels = hinge.sequence.frames()[2:4], hinge.labels[2]
    to_before = np.linalg.inv(hinge.Ts_frame_canonical[3])[hinge.labels[3]]
    after = np.where(hinge.labels[3][:, None] == 1, move_points(T_LID @ to_before, after), after)
    return before, after, labels, np.where(labels[:, None] == 1, move_points(T_LID, before), before)


def guessed_places(clouds, share_right):
    _, after, _, p_true = clouds
    rng = np.random.default_rng(0)
    target = nearest(KDTree(after), p_true)[1]
    wrong = rng.uniform(size=len(target)) > share_right
    return after[np.where(wrong, rng.integers(len(after), size=len(target)), target)]


def nodes_of(points):
    graph = build_graph(points, 60, 4)
    return Nodes(graph.p_nodes, graph.edges[graph.edges[:, 0] < graph.edges[:, 1]], graph.anchors[:, 0].copy())


def test_triples_find_both_motions_among_many_wrong_matches(clouds):
    before, after, labels, _ = clouds
    Ts, seed = suggested_motions(
        before[::20], before, guessed_places(clouds, 0.4), point_spacing(after), np.random.default_rng(0)
    )
    for T_true, own in ((np.eye(4), labels == 0), (T_LID, labels == 1)):
        misses = np.linalg.norm(move_points(Ts[:, None], before[own]) - move_points(T_true, before[own]), axis=-1)
        assert misses.mean(axis=1).min() < 0.05
    assert ((seed >= 0) & (seed < 20)).all()


@pytest.mark.parametrize("share_right", [1.0, 0.4])
def test_every_node_takes_the_motion_of_its_part(clouds, share_right):
    before, after, _, p_true = clouds
    nodes = nodes_of(before)
    Ts = piecewise_rigid(
        nodes,
        Surface.of(before),
        Surface.of(after),
        before,
        guessed_places(clouds, share_right),
        point_spacing(after),
        np.random.default_rng(0),
    )
    miss = np.linalg.norm(move_points(Ts[nodes.of_point], before) - p_true, axis=1)
    assert (miss < 0.03).mean() > 0.9


@pytest.mark.parametrize("count", [0, 2])
def test_with_too_few_matches_all_stands_still(clouds, count):
    before, after, _, _ = clouds
    nodes = nodes_of(before)
    Ts = piecewise_rigid(
        nodes,
        Surface.of(before),
        Surface.of(before),
        before[:count],
        after[:count],
        point_spacing(before),
        np.random.default_rng(0),
    )
    np.testing.assert_allclose(Ts, np.tile(np.eye(4), (60, 1, 1)), atol=1e-9)
