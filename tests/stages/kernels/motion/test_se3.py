import numpy as np
import pytest
import pytransform3d.transformations as oracle
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.kernels.motion import se3

coordinate = st.floats(-3.0, 3.0, allow_nan=False)
twists = st.lists(coordinate, min_size=6, max_size=6).map(lambda values: np.array(values))
SMALL = [0.0, 1e-12, 1e-7, 1e-4]


@given(twists)
@settings(max_examples=60, deadline=None)
def test_exp_agrees_with_pytransform3d(twist):
    ours = se3.exp(torch.from_numpy(twist)).numpy()
    np.testing.assert_allclose(ours, oracle.transform_from_exponential_coordinates(twist), atol=1e-10)


@pytest.mark.parametrize("size", SMALL)
def test_exp_is_exact_for_tiny_rotations(size):
    twist = np.array([size, -size, 0.5 * size, 1.0, 2.0, -3.0])
    expected = oracle.transform_from_exponential_coordinates(twist)
    np.testing.assert_allclose(se3.exp(torch.from_numpy(twist)).numpy(), expected, atol=1e-9)


@given(twists)
@settings(max_examples=60, deadline=None)
def test_log_inverts_exp(twist):
    T = se3.exp(torch.from_numpy(twist))
    again = se3.exp(se3.log(T))
    np.testing.assert_allclose(again.numpy(), T.numpy(), atol=1e-8)


@pytest.mark.parametrize("angle", [np.pi, np.pi - 1e-6])
def test_log_handles_half_turns(angle):
    twist = torch.tensor([0.0, 0.0, angle, 0.3, -0.2, 0.1], dtype=torch.float64)
    T = se3.exp(twist)
    np.testing.assert_allclose(se3.exp(se3.log(T)).numpy(), T.numpy(), atol=1e-6)


@given(twists)
@settings(max_examples=30, deadline=None)
def test_inverse_composes_to_identity(twist):
    T = se3.exp(torch.from_numpy(twist))
    np.testing.assert_allclose((T @ se3.inverse(T)).numpy(), np.eye(4), atol=1e-12)


def test_transform_moves_points_as_the_matrix_does():
    generator = torch.Generator().manual_seed(0)
    Ts = se3.exp(torch.randn(5, 6, generator=generator, dtype=torch.float64))
    p = torch.randn(5, 7, 3, generator=generator, dtype=torch.float64)
    homogeneous = torch.cat([p, torch.ones(5, 7, 1, dtype=torch.float64)], dim=-1)
    expected = torch.einsum("bij,bnj->bni", Ts, homogeneous)[..., :3]
    np.testing.assert_allclose(se3.transform(Ts, p).numpy(), expected.numpy(), atol=1e-12)


@pytest.mark.parametrize("size", [0.0, 1e-6, 0.7])
def test_exp_has_correct_gradients(size):
    twist = torch.tensor([size, -size, size, 0.1, 0.2, 0.3], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(se3.exp, (twist,), atol=1e-5)


def test_skew_is_the_cross_product():
    generator = torch.Generator().manual_seed(1)
    v, w = torch.randn(2, 4, 3, generator=generator, dtype=torch.float64)
    np.testing.assert_allclose(
        (se3.skew(v) @ w[..., None])[..., 0].numpy(), torch.cross(v, w, dim=-1).numpy(), atol=1e-14
    )
