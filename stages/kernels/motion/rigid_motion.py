"""Rigid motions as 4 x 4 matrices, and rotations as rotation vectors, over any leading batch axes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation


def from_parts(R: Float64[np.ndarray, "*batch 3 3"], p: Float64[np.ndarray, "*batch 3"]) -> np.ndarray:
    """The transforms (*batch, 4, 4) that turn by R, then move by p."""
    Ts = np.zeros((*R.shape[:-2], 4, 4))
    Ts[..., :3, :3], Ts[..., :3, 3], Ts[..., 3, 3] = R, p, 1.0
    return Ts


def inverse(Ts: Float64[np.ndarray, "*batch 4 4"]) -> Float64[np.ndarray, "*batch 4 4"]:
    """The inverses of rigid transforms, without a general matrix inversion."""
    R = np.swapaxes(Ts[..., :3, :3], -1, -2)
    return from_parts(R, -(R @ Ts[..., :3, 3:])[..., 0])


def move_points(
    Ts: Float64[np.ndarray, "*#batch 4 4"], p: Float[np.ndarray, "*#batch 3"]
) -> Float64[np.ndarray, "*batch 3"]:
    """Every point by a transform of its own; batch axes are broadcast."""
    moved: np.ndarray = np.einsum("...ij,...j->...i", Ts[..., :3, :3], p) + Ts[..., :3, 3]
    return moved


def best_rotation(covariance: Float64[np.ndarray, "*batch 3 3"]) -> Float64[np.ndarray, "*batch 3 3"]:
    """The rotation that best takes x to y, from the sum of centred x y^T (Kabsch); never a reflection."""
    U, _, Vt = np.linalg.svd(covariance)
    V = Vt.swapaxes(-1, -2).copy()
    V[..., 2] *= np.sign(np.linalg.det(V @ U.swapaxes(-1, -2)))[..., None]
    return V @ U.swapaxes(-1, -2)


def best_motion(
    a: Float64[np.ndarray, "*batch points 3"], b: Float64[np.ndarray, "*batch points 3"]
) -> Float64[np.ndarray, "*batch 4 4"]:
    """The rigid motions that take points a to b with the least squared error."""
    centre_a, centre_b = a.mean(axis=-2, keepdims=True), b.mean(axis=-2, keepdims=True)
    R = best_rotation(np.swapaxes(a - centre_a, -1, -2) @ (b - centre_b))
    return from_parts(R, (centre_b - centre_a @ np.swapaxes(R, -1, -2))[..., 0, :])


def rotation_vectors(R: Float64[np.ndarray, "*batch 3 3"]) -> Float64[np.ndarray, "*batch 3"]:
    """The rotation vectors, of length pi at most, of rotation matrices."""
    vectors: np.ndarray = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return vectors.reshape(R.shape[:-1])


def rotations(rotation_vectors: Float64[np.ndarray, "*batch 3"]) -> Float64[np.ndarray, "*batch 3 3"]:
    """The rotation matrices of rotation vectors."""
    cross = skew(rotation_vectors)
    first, second, _ = _coefficients(rotation_vectors)
    return np.eye(3) + first * cross + second * (cross @ cross)


def left_jacobians(rotation_vectors: Float64[np.ndarray, "*batch 3"]) -> Float64[np.ndarray, "*batch 3 3"]:
    """The left Jacobians J of rotation vectors: a small change d of one turns by J d, as seen from outside."""
    cross = skew(rotation_vectors)
    _, second, third = _coefficients(rotation_vectors)
    return np.eye(3) + second * cross + third * (cross @ cross)


def skew(v: Float64[np.ndarray, "*batch 3"]) -> Float64[np.ndarray, "*batch 3 3"]:
    """The matrices of the cross product: skew(v) @ w = v x w."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def _coefficients(rotation_vectors: Float64[np.ndarray, "*batch 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """sin a / a, (1 - cos a) / a^2 and (a - sin a) / a^3 of the angles a, finite at zero; each (*batch, 1, 1)."""
    squared = np.einsum("...i,...i->...", rotation_vectors, rotation_vectors)[..., None, None]
    angle = np.sqrt(squared)
    first, second = np.sinc(angle / np.pi), np.sinc(angle / (2 * np.pi)) ** 2 / 2
    third = np.where(squared < 1e-4, 1 / 6 - squared / 120, (1 - first) / np.maximum(squared, 1e-4))
    return first, second, third
