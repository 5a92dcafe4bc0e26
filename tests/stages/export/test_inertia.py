import numpy as np
import pytest

from stages.export.inertia import about_axis, solid_of
from stages.kernels.surfaces.meshing import convex_hull


def box(size, centre=(0.0, 0.0, 0.0)):
    corners = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, -1).T
    return convex_hull(corners * size + centre)


def test_a_box_has_the_moments_of_the_textbook():
    solid = solid_of(box((0.2, 0.4, 0.6), centre=(5.0, -1.0, 2.0)))
    assert solid.volume == pytest.approx(0.048)
    assert solid.centre == pytest.approx([5.0, -1.0, 2.0])
    expected = np.diag([0.4**2 + 0.6**2, 0.2**2 + 0.6**2, 0.2**2 + 0.4**2]) * 48 / 12
    assert solid.inertia(48.0, 1e-9) == pytest.approx(expected)


def test_a_needle_is_widened_so_that_simulators_take_it():
    inertia = solid_of(box((1.0, 1e-6, 1e-6))).inertia(1.0, 0.01)
    least, middle, most = np.linalg.eigvalsh(inertia)
    assert least == pytest.approx(2 * 0.01**2)
    assert most <= least + middle


def test_an_axis_beside_the_centre_adds_the_arm_across_it():
    inertia = np.diag([1.0, 2.0, 3.0])
    assert about_axis(inertia, 2.0, np.array([3.0, 0.0, 7.0]), np.array([0.0, 0.0, 1.0])) == pytest.approx(3 + 2 * 9)
