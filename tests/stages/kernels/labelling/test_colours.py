import numpy as np
import pytest

from stages.kernels.labelling.colours import (
    colours_of_true_parts,
    distinct_colours,
    hexadecimal,
    oklab,
    seen_difference,
)


@pytest.mark.parametrize(("count", "least"), [(6, 0.12), (12, 0.07), (30, 0.04)])
def test_the_colour_blind_too_tell_each_two_colours_apart(count, least):
    difference = seen_difference(distinct_colours(count))
    assert difference[~np.eye(count, dtype=bool)].min() > least


def test_colours_stay_the_same_where_more_are_needed():
    np.testing.assert_array_equal(distinct_colours(30)[:7], distinct_colours(7))
    assert distinct_colours(0).shape == (0, 3)


def test_colours_show_on_white_and_on_black():
    lightness = oklab(distinct_colours(40))[:, 0]
    assert lightness.min() > 0.4
    assert lightness.max() < 0.9


def test_lightness_of_white_and_black():
    np.testing.assert_allclose(oklab(np.array([[1.0, 1, 1], [0, 0, 0]])), [[1, 0, 0], [0, 0, 0]], atol=1e-3)


def test_red_and_green_of_one_lightness_are_alike_to_who_lacks_the_cones_for_it():
    pair = np.array([[0.6, 0.35, 0.0], [0.38, 0.48, 0.0]])
    assert seen_difference(pair)[0, 1] < 0.5 * np.linalg.norm(np.diff(oklab(pair), axis=0))


def test_a_true_part_has_the_colour_of_the_part_that_it_is_matched_to_or_its_own():
    labels, labels_true = np.array([0, 0, 0, 1]), np.array([1, 1, 2, 0])
    colours = colours_of_true_parts(labels, labels_true, 3)
    np.testing.assert_array_equal(colours[[1, 0]], distinct_colours(2))
    assert not (colours[2] == distinct_colours(2)).all(axis=1).any()


def test_a_true_part_without_points_has_a_colour():
    labels = np.array([0, 1])
    assert colours_of_true_parts(labels, labels, 5).shape == (5, 3)


def test_hexadecimal():
    assert hexadecimal(np.array([1.0, 0.5, 0.0])) == "#ff8000"
