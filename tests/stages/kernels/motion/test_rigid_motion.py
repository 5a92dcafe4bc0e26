import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.kernels.motion.rigid_motion import (
    best_motion,
    best_rotation,
    from_parts,
    inverse,
    left_jacobians,
    move_points,
    rotation_vectors,
    rotations,
    skew,
)

AXIS = np.array([0.6, 0.0, 0.8])
vectors = st.lists(st.floats(-3.0, 3.0, allow_nan=False), min_size=3, max_size=3).map(np.array)


def random_transforms(*batch):
    rng = np.random.default_rng(0)
    return from_parts(rotations(rng.normal(size=(*batch, 3))), rng.normal(size=(*batch, 3)))


def test_every_point_moves_by_its_own_transform_in_every_frame():
    rng = np.random.default_rng(0)
    Ts, p = random_transforms(2, 5), rng.normal(size=(5, 3))
    moved = move_points(Ts, p)
    assert moved.shape == (2, 5, 3)
    for t, i in np.ndindex(2, 5):
        np.testing.assert_allclose(moved[t, i], (Ts[t, i] @ np.append(p[i], 1.0))[:3], atol=1e-12)


def test_parts_become_a_transform_that_turns_then_moves():
    R = Rotation.random(3, rng=0).as_matrix()
    p = np.arange(9.0).reshape(3, 3)
    Ts = from_parts(R, p)
    np.testing.assert_array_equal(Ts[:, :3, :3], R)
    np.testing.assert_array_equal(Ts[:, :3, 3], p)
    np.testing.assert_array_equal(Ts[:, 3], np.tile([0, 0, 0, 1], (3, 1)))


@given(vectors, vectors)
@settings(max_examples=30, deadline=None)
def test_inverse_composes_to_identity(turn, slide):
    T = from_parts(rotations(turn), slide)
    np.testing.assert_allclose(T @ inverse(T), np.eye(4), atol=1e-12)


def test_inverses_of_a_batch_are_those_of_a_general_inversion():
    Ts = random_transforms(4, 2)
    np.testing.assert_allclose(inverse(Ts), np.linalg.inv(Ts), atol=1e-12)


@given(vectors)
@settings(max_examples=60, deadline=None)
def test_rotations_are_those_of_scipy(turn):
    np.testing.assert_allclose(rotations(turn), Rotation.from_rotvec(turn).as_matrix(), atol=1e-12)


@given(vectors)
@settings(max_examples=60, deadline=None)
def test_rotation_vectors_invert_rotations(turn):
    R = rotations(turn)
    vector = rotation_vectors(R)
    assert np.linalg.norm(vector) <= np.pi + 1e-12
    np.testing.assert_allclose(rotations(vector), R, atol=1e-8)


@pytest.mark.parametrize("angle", [np.pi, np.pi - 1e-6])
def test_rotation_vectors_handle_half_turns(angle):
    R = rotations(angle * np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(rotations(rotation_vectors(R)), R, atol=1e-6)


def test_rotation_vectors_keep_the_axes_of_a_batch():
    turns = 0.5 * np.random.default_rng(0).normal(size=(2, 3, 3))
    np.testing.assert_allclose(rotation_vectors(rotations(turns)), turns, atol=1e-12)
    assert rotation_vectors(np.zeros((0, 3, 3))).shape == (0, 3)


@pytest.mark.parametrize("length", [0.0, 1e-12, 1e-9, 1e-7, 1e-4, 5e-3, 0.02, 1.0, np.pi, 6.0])
def test_rotations_and_their_left_jacobians(length):
    turn = length * AXIS
    R, J = rotations(turn), left_jacobians(turn)
    np.testing.assert_allclose(R, Rotation.from_rotvec(turn).as_matrix(), atol=1e-15)
    for column in range(3):
        step = np.zeros(3)
        step[column] = 1e-6
        change = Rotation.from_rotvec(turn + step) * Rotation.from_rotvec(turn - step).inv()
        np.testing.assert_allclose(change.as_rotvec() / 2e-6, J[:, column], atol=1e-8)


def test_skew_is_the_cross_product():
    v, w = np.random.default_rng(1).normal(size=(2, 4, 3))
    np.testing.assert_allclose((skew(v) @ w[..., None])[..., 0], np.cross(v, w), atol=1e-14)


def test_the_best_rotation_is_the_one_that_was_applied():
    R, p = Rotation.random(rng=0).as_matrix(), np.random.default_rng(0).normal(size=(20, 3))
    p -= p.mean(axis=0)
    np.testing.assert_allclose(best_rotation(p.T @ (p @ R.T)), R, atol=1e-12)
    assert np.linalg.det(best_rotation(p.T @ -p)) == pytest.approx(1)  # of a mirrored set too


def test_the_best_motion_takes_points_to_where_they_went_and_noise_away():
    rng = np.random.default_rng(2)
    Ts, p = random_transforms(4), rng.normal(size=(4, 50, 3))
    there = move_points(Ts[:, None], p)
    np.testing.assert_allclose(best_motion(p, there), Ts, atol=1e-12)
    np.testing.assert_allclose(best_motion(p, there + 0.01 * rng.normal(size=p.shape)), Ts, atol=0.02)
