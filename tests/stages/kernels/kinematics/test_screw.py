import numpy as np
import pytest
import pytransform3d.transformations as oracle
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.kernels.kinematics.screw import fit_screw, nearest_point_to_origin, screw_transform
from stages.kernels.motion import se3

unit = st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)
points = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)


def tensor(*values):
    return torch.tensor(values, dtype=torch.float64)


@given(unit, points, st.floats(-3, 3), st.floats(-2, 2))
@settings(max_examples=60, deadline=None)
def test_screw_transform_agrees_with_pytransform3d(direction, point, angle, distance):
    axis = direction / np.linalg.norm(direction)
    # the oracle parametrises by pitch: turn and slide one after the other instead
    turn = oracle.transform_from_exponential_coordinates(
        oracle.exponential_coordinates_from_transform(np.eye(4))
        if angle == 0
        else np.concatenate([axis, np.cross(point, axis)]) * angle
    )
    slide = np.eye(4)
    slide[:3, 3] = axis * distance
    ours = screw_transform(*(torch.from_numpy(v) for v in (axis, point)), tensor(angle)[0], tensor(distance)[0])
    np.testing.assert_allclose(ours.numpy(), slide @ turn, atol=1e-9)


@given(unit, points)
@settings(max_examples=40, deadline=None)
def test_nearest_point_lies_on_the_axis_and_is_perpendicular_to_it(direction, point):
    axis = torch.from_numpy(direction / np.linalg.norm(direction))
    nearest = nearest_point_to_origin(axis, torch.from_numpy(point))
    assert abs(float(nearest @ axis)) < 1e-12
    np.testing.assert_allclose(torch.linalg.cross(nearest - torch.from_numpy(point), axis).numpy(), 0, atol=1e-12)


AXIS = torch.nn.functional.normalize(tensor(1.0, 2.0, -0.5), dim=0)
POINT = nearest_point_to_origin(AXIS, tensor(0.3, -0.1, 0.2))
ANGLES = torch.linspace(-0.4, 1.1, 8, dtype=torch.float64)
BODY = torch.rand(30, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def same_line(axis, point):
    assert abs(float(axis @ AXIS)) > 1 - 1e-9
    np.testing.assert_allclose(torch.linalg.cross(point - POINT, AXIS).numpy(), 0, atol=1e-5)


@pytest.mark.parametrize("kind", ["screw", "revolute"])
def test_fit_recovers_a_hinge(kind):
    Ts = screw_transform(AXIS, POINT, ANGLES, torch.zeros(8, dtype=torch.float64))
    fit = fit_screw(Ts, BODY, kind)
    same_line(fit.axis, fit.point)
    sign = torch.sign(fit.axis @ AXIS)
    np.testing.assert_allclose((sign * fit.states[:, 0]).numpy(), ANGLES.numpy(), atol=1e-6)
    np.testing.assert_allclose(fit.states[:, 1].numpy(), 0, atol=1e-6)
    assert float(fit.residual) < 1e-10


@pytest.mark.parametrize("kind", ["screw", "prismatic"])
def test_fit_recovers_a_slide(kind):
    Ts = screw_transform(AXIS, POINT, torch.zeros(8, dtype=torch.float64), ANGLES)
    fit = fit_screw(Ts, BODY, kind)
    assert abs(float(fit.axis @ AXIS)) > 1 - 1e-9
    assert torch.all(fit.states[:, 0].abs() < 1e-6)
    np.testing.assert_allclose(fit.states[:, 1].abs().numpy(), ANGLES.abs().numpy(), atol=1e-6)
    assert float(fit.residual) < 1e-10


def test_fit_recovers_a_helix():
    Ts = screw_transform(AXIS, POINT, ANGLES, 0.3 * ANGLES)
    fit = fit_screw(Ts, BODY)
    same_line(fit.axis, fit.point)
    assert float(fit.residual) < 1e-10


def test_fit_survives_half_turns_and_stillness():
    half_turn = screw_transform(AXIS, POINT, tensor(0.0, torch.pi), tensor(0.0, 0.0))
    assert float(fit_screw(half_turn, BODY).residual) < 1e-10
    still = torch.eye(4, dtype=torch.float64).expand(5, 4, 4)
    fit = fit_screw(still, BODY)
    assert torch.isfinite(fit.axis).all()
    assert torch.isfinite(fit.point).all()
    assert float(fit.axis.norm()) == pytest.approx(1.0)
    assert float(fit.residual) < 1e-20


def test_a_ball_joint_leaves_a_residual():
    rotations = torch.randn(8, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    Ts = se3.exp(torch.cat([rotations, torch.zeros(8, 3, dtype=torch.float64)], dim=1))
    assert float(fit_screw(Ts, BODY).residual) > 1e-3


def test_batched_fits_equal_single_ones():
    zero = torch.zeros(8, dtype=torch.float64)
    batch = torch.stack([screw_transform(AXIS, POINT, ANGLES, zero), screw_transform(AXIS, POINT, zero, ANGLES)])
    together = fit_screw(batch, BODY.expand(2, -1, -1))
    for row in range(2):
        alone = fit_screw(batch[row], BODY)
        np.testing.assert_allclose(together.axis[row].numpy(), alone.axis.numpy(), atol=1e-12)
        np.testing.assert_allclose(together.states[row].numpy(), alone.states.numpy(), atol=1e-12)


def test_angles_go_on_past_half_a_turn():
    angles = torch.linspace(-2.0, 5.0, 15, dtype=torch.float64)
    angles = angles - angles[4]
    fit = fit_screw(screw_transform(AXIS, POINT, angles, torch.zeros(15, dtype=torch.float64)), BODY, "revolute")
    sign = torch.sign(fit.axis @ AXIS)
    np.testing.assert_allclose((sign * fit.states[:, 0]).numpy(), angles.numpy(), atol=1e-6)
