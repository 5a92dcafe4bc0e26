import numpy as np
from scipy.spatial.transform import Rotation

from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.normalisation import Normalisation

POINTS = np.random.default_rng(0).uniform(-40, 60, size=(50, 3)) + [1000, 0, -300]


def test_the_box_is_centred_with_a_diagonal_of_one():
    p = Normalisation.of(POINTS.astype(np.float32)).points(POINTS)
    np.testing.assert_allclose(p.min(axis=0), -p.max(axis=0), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(np.ptp(p, axis=0)), 1, atol=1e-6)


def test_a_lone_point_keeps_its_unit():
    assert Normalisation.of(POINTS[:1]).scale == 1.0


def test_motions_move_the_same_points_in_either_frame():
    space = Normalisation.of(POINTS)
    Ts = np.tile(np.eye(4), (50, 1, 1))
    Ts[:, :3, :3] = Rotation.random(50, random_state=0).as_matrix()
    Ts[:, :3, 3] = np.random.default_rng(1).normal(size=(50, 3)) * 30
    there = space.points(move_points(Ts, POINTS))
    np.testing.assert_allclose(move_points(space.motions(Ts), space.points(POINTS)), there, atol=1e-12)
    np.testing.assert_allclose(space.motions_to_input(space.motions(Ts)), Ts, atol=1e-9)
