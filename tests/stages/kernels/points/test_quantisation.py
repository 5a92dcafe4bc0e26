import numpy as np
import pytest

from stages.kernels.points.quantisation import coarseness, quantisation_step

RNG = np.random.default_rng(0)
FAR = np.array([694386.212, 5155487.512, 381.036])


def hinge(count: int, angle: float = 0.7) -> np.ndarray:
    plates = RNG.random((2, count // 2, 3)) * [0.5, 0.5, 0.0]
    c, s = np.cos(angle), np.sin(angle)
    return np.concatenate([plates[0], plates[1] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T])


def box(count: int) -> np.ndarray:
    faces = RNG.integers(0, 6, count)
    points = RNG.random((count, 3))
    points[np.arange(count), faces // 2] = faces % 2
    return points * [0.5, 0.4, 0.3]


def printed(points: np.ndarray) -> np.ndarray:
    """As C++ and `%g` print: six digits."""
    return np.array([[float(f"{value:g}") for value in point] for point in points])


def test_single_precision_far_from_the_origin_is_seen_also_after_a_change_of_frame():
    points = (hinge(800) + FAR).astype(np.float32)
    centre = np.median(points.astype(np.float64), axis=0)
    for seen in (points, (points - centre) / 0.7 * 0.7 + centre):
        np.testing.assert_allclose(quantisation_step(seen), [2.0**-4, 2.0**-1, 2.0**-15])
        assert coarseness(seen) > 5
    assert coarseness(hinge(800) + FAR) == 0


@pytest.mark.parametrize(
    ("points", "step"),
    [
        (printed(hinge(800) + FAR), [1, 10, 0.001]),
        (np.round(hinge(800) + FAR, 1), [0.1, 0.1, 0.1]),
        (np.round(box(800), 1), [0.1, 0.1, 0.1]),
        (np.round(box(40), 1), [0.1, 0.1, 0.1]),
        (np.round(box(4096) * 100), [1, 1, 1]),
        (np.unique(np.round(box(4096) * 100), axis=0), [1, 1, 1]),
    ],
    ids=["six digits", "one decimal, far", "one decimal", "few points", "whole numbers", "voxels"],
)
def test_lost_digits_are_seen_in_the_values(points: np.ndarray, step: list[float]):
    np.testing.assert_allclose(quantisation_step(points), step, rtol=1e-6)
    assert coarseness(points) >= 0.5


@pytest.mark.parametrize("count", [40, 800, 4096, 50_000])
@pytest.mark.parametrize("make", [hinge, box])
def test_ordinary_clouds_are_not_coarse(make, count: int):
    points = make(count)
    rounded = np.round(points, 6).astype(np.float32)
    assert (quantisation_step(points) == 0).all()
    assert quantisation_step(rounded).max() < 1e-7
    for cloud in (points, rounded, np.round(points, 3), points.astype(np.float16), points * 1000, points + 10):
        assert coarseness(cloud) == 0


def grid(heights: np.ndarray | float) -> np.ndarray:
    x, y = np.meshgrid(np.arange(40) * 0.01, np.arange(40) * 0.01)
    return np.column_stack([x.ravel(), y.ravel(), np.broadcast_to(heights, 1600)])


def test_regular_shapes_are_not_coarse():
    flat = RNG.random((500, 3)) * [1, 1, 0]
    shelves = np.column_stack([RNG.random((2000, 2)), RNG.integers(0, 6, 2000) * 0.15])
    curved = np.sin(np.arange(1600) / 100) * 0.1
    clouds = (flat, flat + [0, 0, 0.3], flat + [0, 0, 5000], shelves, hinge(800, 0), hinge(800, np.pi / 2))
    for points in (*clouds, grid(0), grid(curved), grid(np.round(curved, 3))):
        assert coarseness(points) == 0
    assert coarseness(np.ones((40, 3))) == 0


def test_more_than_enough_points_do_not_make_fine_steps_coarse():
    points = np.round(box(200_000), 3)  # a spacing of a millimetre, of which the stages see seven
    assert coarseness(points) == 0
