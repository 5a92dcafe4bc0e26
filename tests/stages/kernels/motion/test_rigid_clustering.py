import numpy as np
from sklearn.metrics import rand_score

from stages.kernels.kinematics.tree import joint_transforms
from stages.kernels.motion.rigid_clustering import merge_rigid_clusters, moments, rigid_motion, rigid_square_sum
from stages.kernels.motion.rigid_motion import move_points

RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-1, 1, size=(60, 3))
LABELS = np.repeat(np.arange(3), 20)


def moved(points, seed, frames=4):
    motions = np.random.default_rng(seed).normal(size=(frames, 6))
    return move_points(joint_transforms(np.zeros(3), motions)[:, None], points)


def naive_residual(x, y):
    """Sum over frames of the Procrustes residual, point by point."""
    total = 0.0
    for frame in y:
        x0, y0 = x - x.mean(0), frame - frame.mean(0)
        U, _, Vt = np.linalg.svd(x0.T @ y0)
        D = np.diag([1, 1, np.sign(np.linalg.det(Vt.T @ U.T))])
        total += ((x0 @ (Vt.T @ D @ U.T).T - y0) ** 2).sum()
    return total


def test_residual_of_rigid_motion_is_zero():
    m = moments(POINTS, moved(POINTS, 1), LABELS, 3)
    np.testing.assert_allclose(rigid_square_sum(m), 0, atol=1e-9)


def test_residual_equals_the_naive_procrustes_residual():
    trajectories = moved(POINTS, 1) + np.random.default_rng(2).normal(scale=0.3, size=(4, 60, 3))
    m = moments(POINTS, trajectories, LABELS, 3)
    expected = [naive_residual(POINTS[k == LABELS], trajectories[:, k == LABELS]) for k in range(3)]
    np.testing.assert_allclose(rigid_square_sum(m), expected, rtol=1e-9)


def test_moments_of_a_union_are_the_sum():
    trajectories = moved(POINTS, 1)
    apart, whole = moments(POINTS, trajectories, LABELS, 3), moments(POINTS, trajectories, LABELS // 2, 2)
    union = apart[0] + apart[1]
    np.testing.assert_allclose(union.xy, whole[0].xy)
    np.testing.assert_allclose(union.squares, whole[0].squares)


def test_rigid_motion_recovers_the_motion_even_of_flat_parts():
    flat = POINTS * [1, 1, 0]
    trajectories = moved(flat, 5)
    Ts = rigid_motion(moments(flat, trajectories, np.zeros(60, dtype=int), 1))
    assert np.all(np.linalg.det(Ts[..., :3, :3]) > 0.999)
    again = move_points(Ts[0][:, None], flat)
    np.testing.assert_allclose(again, trajectories, atol=1e-9)


def test_merging_finds_the_two_bodies_and_respects_contact():
    patch = np.arange(60) // 10  # patches 0-2 are body A, 3-5 body B
    trajectories = np.where((patch < 3)[None, :, None], moved(POINTS, 1), moved(POINTS, 2))
    chain = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 5]])
    start = moments(POINTS, trajectories, patch, 6)
    for merged in (merge_rigid_clusters(start, chain, 2), merge_rigid_clusters(start, chain, 1, max_increase=1e-6)):
        assert rand_score(merged, [0, 0, 0, 1, 1, 1]) == 1.0
        assert set(merged) == {0, 1}
    apart = merge_rigid_clusters(start, chain[[0, 3]], 1)
    assert len(np.unique(apart)) == 4  # patches that do not touch stay apart
