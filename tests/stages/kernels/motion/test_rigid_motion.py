import numpy as np
from scipy.spatial.transform import Rotation

from stages.kernels.motion.rigid_motion import move_points


def test_every_point_moves_by_its_own_transform_in_every_frame():
    rng = np.random.default_rng(0)
    Ts = np.tile(np.eye(4), (2, 5, 1, 1))
    Ts[..., :3, :3] = Rotation.random(10, random_state=0).as_matrix().reshape(2, 5, 3, 3)
    Ts[..., :3, 3] = rng.normal(size=(2, 5, 3))
    p = rng.normal(size=(5, 3))
    moved = move_points(Ts, p)
    assert moved.shape == (2, 5, 3)
    for t, i in np.ndindex(2, 5):
        np.testing.assert_allclose(moved[t, i], (Ts[t, i] @ np.append(p[i], 1.0))[:3], atol=1e-12)
