"""Mass and inertia of closed meshes of uniform density, valid for simulators."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from stages.kernels.surfaces.meshing import Mesh


@dataclass(frozen=True)
class Solid:
    """A body of uniform density. `covariance` is its mean of (p - centre)(p - centre)^T in square metres."""

    volume: float
    centre: Float64[np.ndarray, "3"]
    covariance: Float64[np.ndarray, "3 3"]

    def inertia(self, mass: float, least_radius: float) -> Float64[np.ndarray, "3 3"]:
        """The inertia about the centre. It is positive definite, and its moments satisfy the triangle inequality.

        Both follow from a positive definite covariance. Extents (RMS, metres) below `least_radius` are raised to it.
        """
        variances, axes = np.linalg.eigh(self.covariance)
        variances = np.maximum(variances, least_radius**2)
        return mass * ((axes * (variances.sum() - variances)) @ axes.T)


def solid_of(mesh: Mesh) -> Solid:
    """Volume and moments of a closed mesh, from signed tetrahedra between its middle and each triangle."""
    middle = mesh.vertices.mean(axis=0)
    p = (mesh.vertices - middle)[mesh.triangles]
    volumes = np.linalg.det(p) / 6
    volume = float(volumes.sum())
    sums = p.sum(axis=1)
    centre = (volumes @ sums) / 4 / volume
    # a tetrahedron (0, a, b, c): mean of p p^T = (s s^T + a a^T + b b^T + c c^T) / 20 with s = a + b + c
    second = np.einsum("n,ni,nj->ij", volumes, sums, sums) + np.einsum("n,nki,nkj->ij", volumes, p, p)
    return Solid(volume, middle + centre, second / 20 / volume - np.outer(centre, centre))


def about_axis(
    inertia: Float64[np.ndarray, "3 3"],
    mass: float,
    arm: Float64[np.ndarray, "3"],
    axis: Float64[np.ndarray, "3"],
) -> float:
    """The moment of inertia about an axis at offset `arm` from the centre of mass (Steiner's theorem)."""
    across = arm - axis * (arm @ axis)
    return float(axis @ inertia @ axis + mass * (across @ across))
