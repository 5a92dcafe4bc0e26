import numpy as np
import pytest

from stages.kernels.points.contact import next_to_contact


def test_a_joint_lies_on_its_axis_where_its_parts_meet():
    along = np.linspace(0.0, 1.0, 101)[:, None] * [1.0, 0.0, 0.0]
    axis, point = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.5, 0.0])
    assert next_to_contact(along, along + [1.01, 0.0, 0.0], axis, point) == pytest.approx([1.02, 0.5, 0.0], abs=0.02)


def test_a_part_without_points_has_its_joint_next_to_the_others():
    axis, point = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    origin = next_to_contact(np.zeros((0, 3)), np.array([[1.0, 0.0, 2.0]] * 99), axis, point)
    assert origin == pytest.approx([0.0, 0.0, 2.0], abs=0.03)
