import numpy as np

from stages.flow.trajectories import follow_flow, interpolate
from stages.kernels.nearest import KDTree


def test_interpolation_is_exact_at_samples_and_an_average_between():
    tree = KDTree(np.array([[0.0, 0, 0], [2.0, 0, 0]]))
    values, distance = interpolate(tree, np.array([[1.0], [3.0]]), np.array([[0.0, 0, 0], [1.0, 0, 0]]), 3)
    np.testing.assert_allclose(values[:, 0], [1, 2], atol=1e-6)
    np.testing.assert_allclose(distance, [0, 1])


def test_true_flow_carries_points_to_their_true_place(two_part_object):
    truth = two_part_object
    p_canonical = truth.sequence.frames()[2]
    followed = follow_flow(p_canonical, truth.sequence, truth.true_flow(), 2, 1)
    Ts = truth.Ts_frame_canonical[:, truth.canonical_labels]
    true = np.einsum("tnij,nj->tni", Ts[..., :3, :3], p_canonical) + Ts[..., :3, 3]
    np.testing.assert_array_equal(followed[2], p_canonical)
    assert np.linalg.norm(followed - true, axis=-1).mean() < 0.01
