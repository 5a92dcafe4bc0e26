from __future__ import annotations

import logging

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.config import CleanConfig, IngestConfig
from schemas.errors import InputError
from stages.ingest.cleaning import clean, in_box, in_large_pieces, near_others
from stages.ingest.readers import Frame
from stages.ingest.support_plane import Plane, _fitted, above_support, support_plane


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def box(count: int = 3000, size: tuple[float, float, float] = (0.6, 0.4, 0.8)) -> np.ndarray:
    """The sides and the top of a box that stands on z = 0."""
    p = np.random.default_rng(0).uniform(size=(2 * count, 3))
    side = np.random.default_rng(2).choice(5, 2 * count)
    p[np.arange(2 * count), side // 2] = np.where(side == 4, 1, side % 2)
    return ((p - [0.5, 0.5, 0]) * size)[:count]


def table(count: int = 1500, radius: float = 0.9, height: float = 0.0) -> np.ndarray:
    generator = np.random.default_rng(3)
    r, angle = radius * np.sqrt(generator.random(count)), 2 * np.pi * generator.random(count)
    p = np.stack([r * np.cos(angle), r * np.sin(angle), np.full(count, height)], axis=1)
    return p[(np.abs(p[:, :2]) > [0.3, 0.2]).any(axis=1)]


def noisy(points: np.ndarray, noise: float) -> np.ndarray:
    return points + noise * np.random.default_rng(4).normal(size=points.shape)


def config(**clean: object) -> IngestConfig:
    return IngestConfig(clean=CleanConfig.model_validate(clean))


def framed(*points: np.ndarray) -> list[Frame]:
    return [Frame(f"{index}.ply", p) for index, p in enumerate(points)]


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.01])
def test_the_table_is_taken_and_the_box_on_it_stays_however_it_is_turned(noise: float) -> None:
    points = noisy(np.concatenate([box(), table()]), noise)
    T = Rotation.from_rotvec([1.0, 2.0, -0.5]).as_matrix()
    kept = above_support(100 * points @ T.T + [5, -7, 1000], 0.05, rng())
    of_box = box()[:, 2] > 5 * noise + 1e-6  # the lowest are on the table, too
    assert kept[: len(box())][of_box].mean() > 0.998
    assert kept[len(box()) :].mean() < 0.005


def test_flat_sides_and_open_doors_of_the_object_are_not_taken_for_a_table() -> None:
    door = np.random.default_rng(5).uniform([0.3, 0.2, 0], [0.3001, 0.8, 0.8], size=(2000, 3))
    for points in (box(), np.concatenate([box(), door]), table(), box(size=(1, 1, 0.001))):
        assert support_plane(noisy(points, 0.002), 0.05, rng()) is None
        assert above_support(points, 0.05, rng()).all()


def test_of_two_levels_the_lower_one_is_the_table() -> None:
    foot = table(800, 0.5, 0.05)
    points = noisy(np.concatenate([box() + [0, 0, 0.05], foot, table(3000)]), 0.001)
    kept = above_support(points, 0.05, rng())
    assert kept[: len(box()) + len(foot)].mean() > 0.99
    assert kept[len(box()) + len(foot) :].mean() < 0.01


def test_what_lies_below_the_table_is_taken_with_it() -> None:
    below = np.random.default_rng(6).uniform([-0.5, -0.5, -0.4], [0.5, 0.5, -0.1], size=(50, 3))
    kept = above_support(np.concatenate([box(), table(), below]), 0.05, rng())
    assert not kept[-50:].any()


def test_few_points_and_points_at_one_place_have_no_table() -> None:
    for points in (np.zeros((500, 3)), np.random.default_rng(0).normal(size=(10, 3)), np.zeros((0, 3))):
        assert above_support(points, 0.05, rng()).all()


def test_a_plane_that_no_point_is_near_to_stays_as_it_was() -> None:
    between = Plane(np.array([0.0, 0.0, 1.0]), 5.0)  # as the plane through neighbours on both sides of a gap
    points = np.concatenate([box(), box() + [0, 0, 10]])
    assert abs(_fitted(between, points, 0.01).offset) == 5.0


def test_strays_are_outliers() -> None:
    stray = np.random.default_rng(7).uniform(-1, 1.5, size=(40, 3))
    kept = near_others(np.concatenate([box(), stray]), 20, 2.0)
    assert kept[:3000].mean() > 0.98
    assert kept[3000:].mean() < 0.2
    assert near_others(box(2), 20, 2.0).all()


def test_small_separate_pieces_are_specks_but_the_largest_never_is() -> None:
    speck = box(40, (0.05, 0.05, 0.05)) + [2, 0, 0]
    points = np.concatenate([box(), speck])
    kept = in_large_pieces(points, 0.02, 6.0)
    assert kept[:3000].all()
    assert not kept[3000:].any()
    assert in_large_pieces(points, 0.01, 6.0).all()
    assert in_large_pieces(points, 0.02, 1e6).all()
    assert in_large_pieces(box(), 0.9, 0.01).any()


def test_a_crop_box_keeps_what_is_in_it() -> None:
    points = np.array([[0.0, 0, 0], [1, 1, 1], [2, 0, 0], [0, -1, 0]])
    assert in_box(points, (0, 0, 0, 1, 1, 1)).tolist() == [True, True, False, False]


def test_each_step_reports_what_it_took_and_points_follow(caplog: pytest.LogCaptureFixture) -> None:
    speck = box(40, (0.05, 0.05, 0.05)) + [1.4, 0, 0.5]
    far = np.full((5, 3), 50.0) + np.arange(5)[:, None]
    invalid = np.full((2, 3), np.nan)
    points = noisy(np.concatenate([box(), table(), speck, far, invalid]), 0.001)
    colours = np.arange(3 * len(points)).reshape(-1, 3).astype(np.uint8)
    frames = [Frame("a.ply", points, colours=colours), Frame("b.ply", noisy(box(), 0.001))]
    settings = config(plane=True, box=(-3, -3, -3, 3, 3, 3), specks=0.02)
    cleaned = clean(frames, settings, rng())
    assert cleaned.taken["box"] == (5, 0)
    assert cleaned.taken["plane"][0] >= len(table())
    assert cleaned.taken["plane"][1] == 0
    assert cleaned.taken["specks"][0] in range(35, 60)
    assert "outliers" not in cleaned.taken
    for frame, before, kept in zip(cleaned.frames, frames, cleaned.kept, strict=True):
        np.testing.assert_array_equal(frame.points, before.points[kept])
    np.testing.assert_array_equal(cleaned.frames[0].colours, colours[cleaned.kept[0]])
    assert np.isnan(cleaned.frames[0].points).sum() == 6  # left for the next step, which counts them
    (remark,) = cleaned.remarks()
    total = sum(map(sum, cleaned.taken.values()))
    assert remark.startswith(f"the clean-up took {total:,} of {len(points) + 3000:,} points: 5 outside of the box, ")
    assert "found no plane that the object stands on in 1 of 2 frames (b.ply)" in caplog.text


def test_nothing_is_done_or_said_where_nothing_is_asked(caplog: pytest.LogCaptureFixture) -> None:
    frames = framed(box(), box(50))
    with caplog.at_level(logging.INFO):
        cleaned = clean(frames, IngestConfig(), rng())
    assert cleaned.frames == frames
    assert cleaned.taken == {}
    assert cleaned.remarks() == ()
    assert not caplog.records


def test_too_few_points_left_are_one_line() -> None:
    with pytest.raises(InputError) as caught:
        clean(framed(box(), box()), config(box=(0, 0, 5, 1, 1, 6)), rng())
    message = str(caught.value)
    assert message.startswith("0.ply: the clean-up left 0 of 3000 points (3000 outside of the box), expected at least")
    assert "ingest.clean" in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "wrong", [{"box": (0, 0, 0, 1, 1)}, {"box": (0, 0, 0, 1, -1, 1)}, {"specks": 1.0}, {"outliers": -1.0}, {"cube": 1}]
)
def test_settings_out_of_range_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"validation error"):
        config(**wrong)
