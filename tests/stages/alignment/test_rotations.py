import numpy as np
from scipy.spatial.transform import Rotation

from stages.alignment.rotations import even_rotations, upright_rotations


def test_no_orientation_is_far_from_an_even_rotation():
    even = Rotation.from_matrix(even_rotations(600))
    turns = Rotation.random(200, rng=np.random.default_rng(0))
    nearest = np.array([(even * turn.inv()).magnitude().min() for turn in turns])
    assert np.degrees(nearest.max()) < 32


def test_upright_rotations_keep_the_vertical():
    upright = upright_rotations(36)
    np.testing.assert_allclose(upright @ [0, 0, 1], np.tile([0, 0, 1], (36, 1)), atol=1e-12)
    assert len({round(angle) for angle in Rotation.from_matrix(upright).as_euler("ZYX", degrees=True)[:, 0]}) == 36
