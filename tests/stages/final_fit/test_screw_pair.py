import numpy as np
import pytest

from stages.final_fit.screw_pair import fit_screw_pair
from stages.kernels.kinematics.tree import joint_transforms

CANONICAL, NOISE = 2, 0.02
FIRST = np.array([-0.6, 0.5, 0.0, -0.2, 0.4, -0.5, 0.7])
SECOND = np.array([0.5, 0.6, 0.0, -0.4, -0.6, -0.3, 0.3])
BODY = np.random.default_rng(0).uniform(-0.2, 0.2, size=(60, 3)) + [0.4, 0.0, 0.1]


def screw(axis, point, angles):
    return joint_transforms(np.asarray(point, dtype=float), np.outer(angles, [*axis, 0, 0, 0]))


def apart(degrees):
    return np.array([[0.0, 0.0, 1.0], [0.0, np.sin(np.radians(degrees)), np.cos(np.radians(degrees))]])


@pytest.mark.parametrize("degrees", [90, 60])
@pytest.mark.parametrize("offset", [[0.0, 0.0, 0.0], [0.08, 0.0, -0.05]])
def test_a_known_pair_is_recovered(degrees, offset):
    axis, point = apart(degrees), np.array([[0.0, 0.0, 0.0], offset])
    Ts = screw(axis[0], point[0], FIRST) @ screw(axis[1], point[1], SECOND)
    pair = fit_screw_pair(Ts, BODY, np.array([0.05, -0.03, 0.04]), CANONICAL, NOISE, 15, 6)
    assert pair.rms < 0.02 * NOISE
    signs = np.sign((pair.axis * axis).sum(axis=1))
    assert np.all((pair.axis * axis).sum(axis=1) * signs > np.cos(np.radians(1)))
    np.testing.assert_allclose(pair.states * signs, np.stack([FIRST, SECOND], axis=1), atol=0.02)
    np.testing.assert_allclose(np.cross(pair.point - point, axis), 0, atol=0.005)
    np.testing.assert_array_equal(pair.states[CANONICAL], 0)


def test_the_residual_is_what_the_pair_leaves():
    twists = np.random.default_rng(3).normal(scale=0.4, size=(7, 6))
    twists[:, 3:] = 0
    twists[CANONICAL] = 0
    Ts = joint_transforms(np.zeros(3), twists)  # a ball joint
    pair = fit_screw_pair(Ts, BODY, np.zeros(3), CANONICAL, NOISE, 15, 6)
    first, second = (screw(pair.axis[k], pair.point[k], pair.states[:, k]) for k in (0, 1))
    p = np.concatenate([BODY, np.ones((60, 1))], axis=1)
    left = np.einsum("tij,nj->tni", (first @ second - Ts)[:, :3], p)
    assert pair.rms == pytest.approx(np.sqrt((left**2).sum(axis=-1).mean()))
    assert pair.rms > 0.5 * NOISE


def test_a_plain_hinge_hardly_turns_its_second_joint():
    Ts = screw([0.0, 1.0, 0.0], [0.1, 0.0, 0.0], FIRST)
    pair = fit_screw_pair(Ts, BODY, np.zeros(3), CANONICAL, NOISE, 15, 6)
    assert pair.rms < 0.05 * NOISE
    turns = np.ptp(pair.states, axis=0)
    assert turns.min() < 0.02 * np.ptp(FIRST)
    assert turns.max() == pytest.approx(np.ptp(FIRST), rel=0.05)
    assert abs(pair.axis[turns.argmax(), 1]) > np.cos(np.radians(2))


def test_the_unit_of_length_does_not_matter():
    axis = apart(75)
    pairs = []
    for scale in (1.0, 1000.0):
        Ts = screw(axis[0], np.zeros(3), FIRST) @ screw(axis[1], [0.05 * scale, 0.0, 0.0], SECOND)
        pairs.append(
            fit_screw_pair(Ts, scale * BODY, np.array([0.0, 0.0, 0.02 * scale]), CANONICAL, scale * NOISE, 15, 6)
        )
    signs = np.sign((pairs[0].axis * pairs[1].axis).sum(axis=1))
    np.testing.assert_allclose(pairs[0].axis, signs[:, None] * pairs[1].axis, atol=1e-6)
    np.testing.assert_allclose(pairs[0].states, signs * pairs[1].states, atol=1e-6)
    offsets = np.cross(1000 * pairs[0].point - pairs[1].point, pairs[1].axis)
    np.testing.assert_allclose(offsets, 0, atol=1e-3)
