import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from schemas.joints import FREE, PRISMATIC, REVOLUTE, SCREW, SPHERICAL
from stages.kernels.kinematics.closed_form import fit_joint, nearest_point_to_origin
from stages.kernels.kinematics.tree import joint_transforms

unit = st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)
points = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)


@given(unit, points)
@settings(max_examples=40, deadline=None)
def test_nearest_point_lies_on_the_axis_and_is_perpendicular_to_it(direction, point):
    axis = direction / np.linalg.norm(direction)
    nearest = nearest_point_to_origin(axis, point)
    assert abs(nearest @ axis) < 1e-12
    np.testing.assert_allclose(np.cross(nearest - point, axis), 0, atol=1e-12)


AXIS = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
POINT = nearest_point_to_origin(AXIS, np.array([0.3, -0.1, 0.2]))
ANGLES = np.linspace(-0.4, 1.1, 8)
BODY = np.random.default_rng(0).uniform(size=(30, 3))


def screw(angles, distances=0.0, axis=AXIS, point=POINT):
    """Turns about an axis and slides along it, one each frame."""
    angles, distances = np.broadcast_arrays(angles, distances)
    return joint_transforms(point, np.concatenate([angles[:, None] * axis, distances[:, None] * axis], axis=1))


def same_line(axis, point):
    assert abs(axis @ AXIS) > 1 - 1e-9
    np.testing.assert_allclose(np.cross(point - POINT, AXIS), 0, atol=1e-5)


@pytest.mark.parametrize("kind", [SCREW, REVOLUTE])
def test_fit_recovers_a_hinge(kind):
    fit = fit_joint([kind], screw(ANGLES), BODY)
    same_line(fit.axis, fit.point)
    sign = np.sign(fit.axis @ AXIS)
    np.testing.assert_allclose(fit.motions[:, :3], ANGLES[:, None] * AXIS, atol=1e-6)
    np.testing.assert_allclose(fit.motions[:, 3:], 0, atol=1e-6)
    np.testing.assert_allclose(sign * fit.states_of()[:, 0], ANGLES, atol=1e-6)
    assert fit.mean_square < 1e-10


@pytest.mark.parametrize("kind", [SCREW, PRISMATIC])
def test_fit_recovers_a_slide(kind):
    fit = fit_joint([kind], screw(0.0, ANGLES), BODY)
    assert abs(fit.axis @ AXIS) > 1 - 1e-9
    assert np.all(np.abs(fit.motions[:, :3]) < 1e-6)
    np.testing.assert_allclose(fit.motions[:, 3:], ANGLES[:, None] * AXIS, atol=1e-6)
    np.testing.assert_allclose(np.abs(fit.states_of()[:, -1]), np.abs(ANGLES), atol=1e-6)
    assert fit.mean_square < 1e-10


def test_fit_recovers_a_helix():
    fit = fit_joint([SCREW], screw(ANGLES, 0.3 * ANGLES), BODY)
    same_line(fit.axis, fit.point)
    assert fit.mean_square < 1e-10
    sign = np.sign(fit.axis @ AXIS)
    np.testing.assert_allclose(sign * fit.states_of(), np.stack([ANGLES, 0.3 * ANGLES], axis=1), atol=1e-5)


@pytest.mark.parametrize("size", [0.05, 0.5, 1.5])
def test_fit_recovers_a_balls_centre(size):
    turns, centre = size * np.random.default_rng(3).normal(size=(8, 3)), np.array([0.3, -0.1, 0.2])
    turns = Rotation.from_rotvec(turns).as_rotvec()  # of half a turn at most
    Ts = joint_transforms(centre, np.pad(turns, [(0, 0), (0, 3)]))
    fit = fit_joint([SPHERICAL], Ts, BODY)
    np.testing.assert_allclose(fit.point, centre, atol=1e-5)
    np.testing.assert_allclose(fit.states_of(), turns, atol=1e-9)
    np.testing.assert_allclose(fit.transforms(), Ts, atol=1e-5)
    assert fit.mean_square < 1e-10
    assert np.linalg.norm(fit.axis) == pytest.approx(1)


def test_a_free_motion_is_explained_by_a_free_joint_only():
    Ts = joint_transforms(np.zeros(3), np.random.default_rng(4).normal(size=(8, 6)))
    free, ball = (fit_joint([kind], Ts, BODY) for kind in (FREE, SPHERICAL))
    np.testing.assert_allclose(free.transforms(), Ts, atol=1e-9)
    assert ball.mean_square > 1e-3


def test_the_mean_square_is_what_the_joint_leaves_of_the_points():
    Ts = joint_transforms(np.zeros(3), np.random.default_rng(4).normal(scale=0.3, size=(8, 6)))
    for kind in (REVOLUTE, PRISMATIC, SPHERICAL, SCREW):
        fit = fit_joint([kind], Ts, BODY)
        p = np.concatenate([BODY, np.ones((30, 1))], axis=1)
        left = np.einsum("tij,nj->tni", (fit.transforms() - Ts)[:, :3], p)
        assert fit.mean_square == pytest.approx((left**2).sum(axis=-1).mean())
        assert fit.rms == pytest.approx(np.sqrt(fit.mean_square))


def test_each_motion_gets_the_kind_that_leaves_less_of_it():
    turns = np.random.default_rng(3).normal(size=(8, 3))
    ball = joint_transforms(POINT, np.pad(turns, [(0, 0), (0, 3)]))
    Ts = np.stack([screw(ANGLES), screw(0.0, ANGLES), ball])
    body = np.broadcast_to(BODY, (3, 30, 3))
    two, three = (fit_joint(kinds, Ts, body) for kinds in ([REVOLUTE, PRISMATIC], [PRISMATIC, REVOLUTE, SPHERICAL]))
    assert [two.kind_of((row,)) for row in range(2)] == [REVOLUTE, PRISMATIC]
    assert three.kind_of((1,)) == PRISMATIC
    assert three.kind_of((2,)) == SPHERICAL
    assert [three.states_of((row,)).shape for row in (1, 2)] == [(8, 1), (8, 3)]
    assert three.rms.max() < 1e-5 < two.rms[2]
    for row, kind in enumerate((REVOLUTE, PRISMATIC)):
        alone = fit_joint([kind], Ts[row], BODY)
        for name in ("axis", "point", "motions", "mean_square"):
            np.testing.assert_allclose(getattr(two, name)[row], getattr(alone, name), atol=1e-12)


def test_of_kinds_that_leave_the_same_the_first_wins():
    still = np.tile(np.eye(4), (5, 1, 1))
    for kinds in ([REVOLUTE, PRISMATIC], [PRISMATIC, REVOLUTE], [SPHERICAL, REVOLUTE]):
        assert fit_joint(kinds, still, BODY).kind_of() == kinds[0]


def test_fit_survives_half_turns_and_stillness():
    assert fit_joint([SCREW], screw(np.array([0.0, np.pi])), BODY).mean_square < 1e-10
    still = np.tile(np.eye(4), (5, 1, 1))
    for kind in (SCREW, REVOLUTE, PRISMATIC, SPHERICAL):
        fit = fit_joint([kind], still, BODY)
        assert np.isfinite(fit.axis).all()
        assert np.isfinite(fit.point).all()
        assert np.linalg.norm(fit.axis) == pytest.approx(1.0)
        assert fit.mean_square < 1e-20


def test_a_ball_joint_leaves_a_residual():
    turns = np.random.default_rng(3).normal(size=(8, 3))
    Ts = joint_transforms(np.zeros(3), np.pad(turns, [(0, 0), (0, 3)]))
    assert fit_joint([SCREW], Ts, BODY).mean_square > 1e-3


@pytest.mark.parametrize("kind", [SCREW, REVOLUTE, PRISMATIC, SPHERICAL])
def test_batched_fits_equal_single_ones(kind):
    batch = np.stack([screw(ANGLES), screw(0.0, ANGLES)])
    together = fit_joint([kind], batch, np.broadcast_to(BODY, (2, 30, 3)))
    for row in range(2):
        alone = fit_joint([kind], batch[row], BODY)
        np.testing.assert_allclose(together.axis[row], alone.axis, atol=1e-12)
        np.testing.assert_allclose(together.motions[row], alone.motions, atol=1e-12)
        np.testing.assert_allclose(together.states_of((row,)), alone.states_of(), atol=1e-12)


def test_angles_go_on_past_half_a_turn():
    angles = np.linspace(-2.0, 5.0, 15)
    angles = angles - angles[4]
    fit = fit_joint([REVOLUTE], screw(angles), BODY)
    sign = np.sign(fit.axis @ AXIS)
    np.testing.assert_allclose(sign * fit.states_of()[:, 0], angles, atol=1e-6)


@pytest.mark.parametrize(("kind", "Ts"), [(REVOLUTE, screw(ANGLES)), (PRISMATIC, screw(0.0, ANGLES))])
def test_states_can_be_counted_from_any_frame(kind, Ts):
    fit = fit_joint([kind], Ts, BODY).since(3)
    np.testing.assert_array_equal(fit.states_of()[3], 0)
    np.testing.assert_allclose(fit.transforms(), Ts @ np.linalg.inv(Ts[3]), atol=1e-5)


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [
        ([0, 80, 160, 240, 320, 400], [0, 80, 160, 240, 320, 400]),  # a wheel that turns on
        ([0, 130, -70, 100, -40], [0, 130, -70, 100, -40]),  # in no order, over 200 degrees
        ([0, 170, 20, 230, 60], [0, 170, 20, 230, 60]),  # beyond half a turn
    ],
)
def test_angles_of_frames_in_order_and_in_none(degrees, expected):
    fit = fit_joint([REVOLUTE], screw(np.radians(degrees)), BODY)
    states = np.degrees(np.sign(fit.axis @ AXIS) * fit.states_of()[:, 0])
    np.testing.assert_allclose(states, expected, atol=1e-4)
