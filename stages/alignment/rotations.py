"""Rotations that cover all orientations evenly."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

PSI = 1.533751168755204288118041  # the real root of psi^4 = psi + 4


def even_rotations(count: int) -> Float64[np.ndarray, "count 3 3"]:
    """Rotations spread evenly over all of SO(3): super-Fibonacci spirals (Alexa, CVPR 2022)."""
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    a, b = 2 * np.pi * s / np.sqrt(2.0), 2 * np.pi * s / PSI
    quaternions = np.stack([inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)], axis=1)
    return np.asarray(Rotation.from_quat(quaternions).as_matrix())


def upright_rotations(count: int) -> Float64[np.ndarray, "count 3 3"]:
    """Turns about the vertical (z) by even angles."""
    turns = np.outer(2 * np.pi * np.arange(count) / count, [0.0, 0.0, 1.0])
    return np.asarray(Rotation.from_rotvec(turns).as_matrix())
