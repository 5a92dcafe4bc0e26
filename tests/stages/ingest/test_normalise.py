from __future__ import annotations

import logging

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.config import IngestConfig
from schemas.errors import InputError
from schemas.sequence import PointSequence, TrueJoint
from stages.ingest.normalise import normalise, normalise_transforms, normalise_truth
from stages.ingest.readers import Frame
from stages.ingest.truth import RawTruth

CONFIG = IngestConfig()


def clouds(*counts: int, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [rng.uniform([-1, 2, 5], [3, 4, 6], size=(count, 3)) for count in counts]


def framed(points: list[np.ndarray]) -> list[Frame]:
    return [Frame(f"frame_{index}.ply", of_frame) for index, of_frame in enumerate(points)]


def ingested(points: list[np.ndarray]) -> PointSequence:
    return normalise(framed(points), CONFIG, "unknown")


def refusal(points: list[np.ndarray], config: IngestConfig = CONFIG) -> str:
    with pytest.raises(InputError) as caught:
        normalise(framed(points), config, "unknown")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def diagonal(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def moved(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ T[:3, :3].T + T[:3, 3]


def random_transforms(rng: np.random.Generator, *shape: int) -> np.ndarray:
    Ts = np.tile(np.eye(4), (*shape, 1, 1))
    Ts[..., :3, :3] = Rotation.random(int(np.prod(shape)), random_state=rng).as_matrix().reshape(*shape, 3, 3)
    Ts[..., :3, 3] = rng.normal(size=(*shape, 3))
    return Ts


def test_points_go_to_a_centred_box_of_unit_diagonal_and_back() -> None:
    points = clouds(50, 80, 64)
    sequence = normalise(framed(points), CONFIG, "millimetre")
    boxes = [(of_frame.min(axis=0) + of_frame.max(axis=0)) / 2 for of_frame in sequence.frames()]
    np.testing.assert_allclose(np.median(boxes, axis=0), 0, atol=1e-12)
    assert np.median([diagonal(of_frame) for of_frame in sequence.frames()]) == pytest.approx(1)
    np.testing.assert_allclose(sequence.to_input(sequence.points), np.concatenate(points), rtol=1e-12)
    assert sequence.point_counts.tolist() == [50, 80, 64]
    assert sequence.dropped_counts.tolist() == [0, 0, 0]
    assert sequence.units == "millimetre"
    assert sequence.frame_names == ("frame_0.ply", "frame_1.ply", "frame_2.ply")


def test_viewpoints_are_normalised_with_the_points_where_all_frames_have_some() -> None:
    points, seen = clouds(50, 60), np.random.default_rng(3).normal(size=(2, 4, 3))
    frames = [Frame(f"{t}.ply", of_frame, views) for t, (of_frame, views) in enumerate(zip(points, seen, strict=True))]
    sequence = normalise(frames, CONFIG, "unknown")
    np.testing.assert_allclose(sequence.to_input(sequence.viewpoints), seen)
    np.testing.assert_array_equal(sequence.points, ingested(points).points)
    assert ingested(points).viewpoints is None
    assert normalise([frames[0], Frame("1.ply", points[1])], CONFIG, "unknown").viewpoints is None


def test_differing_numbers_of_viewpoints_are_refused() -> None:
    points = clouds(50, 60)
    frames = [Frame(f"{t}.ply", of_frame, np.zeros((t + 1, 3))) for t, of_frame in enumerate(points)]
    with pytest.raises(InputError, match=r"1\.ply: found 2 viewpoints, but 1 in 0\.ply"):
        normalise(frames, CONFIG, "unknown")


def test_scale_and_centre_do_not_follow_a_stray_point_in_one_frame() -> None:
    points = clouds(50, 50, 50)
    clean = ingested(points)
    points[1] = np.vstack([points[1], [100.0, 3.0, 5.0]])
    strayed = ingested(points)
    assert strayed.scale == pytest.approx(clean.scale, rel=0.1)
    np.testing.assert_allclose(strayed.centre, clean.centre, atol=0.1 * clean.scale)


def test_normalised_points_do_not_depend_on_units_or_place() -> None:
    points = clouds(50, 60)
    there = ingested([of_frame * 1000 + [5e5, -2e4, 10] for of_frame in points])
    np.testing.assert_allclose(there.points, ingested(points).points, atol=1e-9)


def test_points_with_nan_or_infinity_are_dropped_counted_and_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    points = clouds(50, 50, 50)
    points[0][3, 1], points[2][7], points[2][9, 0] = np.nan, np.inf, -np.inf
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        sequence = ingested(points)
    assert sequence.point_counts.tolist() == [49, 50, 48]
    assert sequence.dropped_counts.tolist() == [1, 0, 2]
    np.testing.assert_allclose(sequence.to_input(sequence.frames()[0]), np.delete(points[0], 3, axis=0))
    (record,) = caplog.records
    assert record.name == "rearticulate.ingest"
    assert "dropped 3 points" in record.message
    assert "1 of 50 in frame_0.ply, 2 of 50 in frame_2.ply" in record.message
    assert "\n" not in record.message


def test_colours_follow_the_kept_points(caplog: pytest.LogCaptureFixture) -> None:
    points = clouds(50, 60)
    points[1][3, 1] = np.nan
    colours = [np.random.default_rng(0).integers(256, size=p.shape).astype(np.uint8) for p in points]
    frames = [Frame(f"{index}.ply", points[index], colours=colours[index]) for index in range(2)]
    found = normalise(frames, CONFIG, "unknown").colours
    np.testing.assert_array_equal(found, np.concatenate([colours[0], np.delete(colours[1], 3, axis=0)]))
    assert "colours" not in caplog.text
    frames[1] = Frame("1.ply", points[1])
    assert normalise(frames, CONFIG, "unknown").colours is None
    assert "left out the colours, which 1.ply" in caplog.text


def test_the_warning_stays_short_for_many_frames_and_silent_without_cause(caplog: pytest.LogCaptureFixture) -> None:
    points = clouds(*[50] * 20)
    ingested(points)
    assert not caplog.records
    for of_frame in points:
        of_frame[0] = np.nan
    ingested(points)
    assert "and 15 more frames" in caplog.text


def test_too_few_finite_points_are_refused() -> None:
    points = clouds(40, 40)
    points[1][:9] = np.nan
    message = refusal(points)
    assert message.startswith("frame_1.ply: found 31 points")
    assert "at least 32" in message
    assert normalise(framed(points), IngestConfig(min_points=31), "unknown").point_counts.tolist() == [40, 31]
    assert "found 0 points" in refusal([clouds(40)[0], np.empty((0, 3))])


def test_points_that_are_all_equal_are_refused_also_in_one_frame_alone() -> None:
    point = np.array([0.1, -70.3, 1e5])
    assert refusal([np.tile(point, (40, 1))] * 3).startswith("frame_0.ply: found 40 points that are all equal")
    assert refusal([*clouds(40, 40), np.tile(point, (40, 1))]).startswith("frame_2.ply")
    assert "all equal" in refusal([np.zeros((40, 3))] * 2)
    assert "all equal" in refusal([1e-200 * of_frame for of_frame in clouds(40, 40)])


def test_a_flat_or_thin_object_is_no_error() -> None:
    flat = [of_frame * [1, 1, 0] for of_frame in clouds(40, 40)]
    assert ingested(flat).scale > 0


@pytest.mark.parametrize(("factor", "odd"), [(1000, 2), (0.001, 2), (1000, 0)])
def test_mixed_units_are_refused_with_the_odd_frame_and_the_factor(factor: float, odd: int) -> None:
    points = [clouds(500)[0] for _ in range(4)]
    points[odd] = points[odd] * factor
    message = refusal(points)
    assert message.startswith(f"frame_{odd}.ply: ")
    assert "a factor of 1000" in message


def test_an_object_that_unfolds_is_no_error() -> None:
    points = clouds(40, 40)
    assert ingested([points[0], 50 * points[1]]).frame_count == 2


@pytest.mark.parametrize("value", [1.1e12, 1e20, -1e160, 1e308])
def test_coordinates_beyond_what_artifacts_hold_are_refused(value: float) -> None:
    points = clouds(40, 40)
    points[1][5, 2] = value
    message = refusal(points)
    assert message.startswith("frame_1.ply")
    assert "expected at most 1e+12" in message


def raw_truth(points: list[np.ndarray], joints: tuple[TrueJoint, ...] = ()) -> RawTruth:
    rng = np.random.default_rng(1)
    Ts = random_transforms(rng, len(points), 3)
    Ts[0] = np.eye(4)
    return RawTruth(
        labels=[rng.integers(3, size=len(of_frame)) for of_frame in points],
        Ts_frame_first=Ts,
        Ts_novel_first=random_transforms(rng, 2, 3),
        parent=np.array([-1, 0, 1]),
        part_names=("base", "arm", "hand"),
        joints=joints,
        own_coordinates=True,
    )


def test_moving_normalised_points_equals_normalising_moved_points() -> None:
    points = clouds(40, 50)
    truth, sequence = raw_truth(points), ingested(points)
    normalised = normalise_truth(truth, framed(points), sequence)
    for Ts_raw, Ts in (
        (truth.Ts_frame_first, normalised.Ts_frame_first),
        (truth.Ts_novel_first, normalised.Ts_novel_first),
    ):
        for T_raw, T in zip(Ts_raw.reshape(-1, 4, 4), Ts.reshape(-1, 4, 4), strict=True):
            p_first = sequence.frames()[0]
            expected = (moved(T_raw, points[0]) - sequence.centre) / sequence.scale
            np.testing.assert_allclose(moved(T, p_first), expected, atol=1e-12)
    assert normalised.part_names == truth.part_names
    assert normalised.own_coordinates == truth.own_coordinates
    np.testing.assert_array_equal(normalised.parent, truth.parent)


def test_normalised_transforms_compose_and_leave_the_input_alone() -> None:
    sequence = ingested(clouds(40, 50))
    T, U = random_transforms(np.random.default_rng(2), 2)
    before = T.copy()
    product = normalise_transforms(T, sequence) @ normalise_transforms(U, sequence)
    np.testing.assert_allclose(product, normalise_transforms(T @ U, sequence), atol=1e-12)
    np.testing.assert_array_equal(T, before)


def test_joints_are_normalised_so_that_they_still_produce_their_motion() -> None:
    points = clouds(40, 50)
    sequence = ingested(points)
    axis, point = np.array([0.6, 0.0, 0.8]), np.array([1.0, -2.0, 3.0])
    common = {"parent": 0, "axis": tuple(axis), "point": tuple(point)}
    turning = TrueJoint(name="t", child=1, type="revolute", states=(0.0, 0.7), **common)
    sliding = TrueJoint(name="s", child=2, type="prismatic", states=(0.0, 0.4), **common)
    T_turn, T_slide = np.eye(4), np.eye(4)
    T_turn[:3, :3] = Rotation.from_rotvec(0.7 * axis).as_matrix()
    T_turn[:3, 3] = point - T_turn[:3, :3] @ point
    T_slide[:3, 3] = 0.4 * axis
    normalised = normalise_truth(raw_truth(points, (turning, sliding)), framed(points), sequence)
    turn, slide = normalised.joints
    R = Rotation.from_rotvec(turn.states[1] * np.array(turn.axis)).as_matrix()
    expected = normalise_transforms(T_turn, sequence)
    np.testing.assert_allclose(R, expected[:3, :3], atol=1e-12)
    np.testing.assert_allclose(np.array(turn.point) - R @ turn.point, expected[:3, 3], atol=1e-12)
    shift = slide.states[1] * np.array(slide.axis)
    np.testing.assert_allclose(shift, normalise_transforms(T_slide, sequence)[:3, 3], atol=1e-12)


def test_dropped_points_lose_their_labels() -> None:
    points = clouds(40, 50)
    truth = raw_truth(points)
    points[0][[0, 7]], points[1][49, 2] = np.nan, np.inf
    normalised = normalise_truth(truth, framed(points), ingested(points))
    expected = np.concatenate([np.delete(truth.labels[0], [0, 7]), truth.labels[1][:49]])
    np.testing.assert_array_equal(normalised.labels, expected)


def test_a_truth_that_does_not_fit_the_frames_is_refused() -> None:
    points = clouds(40, 50)
    truth, sequence = raw_truth(points), ingested(points)
    with pytest.raises(InputError, match="labels: found"):
        normalise_truth(truth, framed([points[0], points[1][:49]]), sequence)


def test_a_truth_that_does_not_start_from_frame_0_is_refused() -> None:
    points = clouds(40, 50)
    truth, sequence = raw_truth(points), ingested(points)
    truth.Ts_frame_first[0, 1, 0, 3] = 0.1
    with pytest.raises(InputError, match="part 1 is moved in frame 0"):
        normalise_truth(truth, framed(points), sequence)


def test_a_truth_in_units_much_smaller_than_the_frames_is_refused() -> None:
    points = [1e-9 * of_frame for of_frame in clouds(40, 50)]
    truth, sequence = raw_truth(points), ingested(points)
    truth.Ts_novel_first[0, 1, 0, 3] = 1e10
    with pytest.raises(InputError, match=r"ground truth: found a motion by .* times the object's size"):
        normalise_truth(truth, framed(points), sequence)


def test_points_on_one_line_are_refused_and_a_flat_frame_is_not() -> None:
    along = np.random.default_rng(0).uniform(size=(40, 1))
    line = along * [0.3, -0.5, 0.2] + [10.0, 20.0, 30.0]
    assert refusal([*clouds(40), line]).startswith("frame_1.ply: found 40 points on one straight line")
    flat = clouds(40)[0] * [1.0, 1.0, 0.0]
    assert normalise(framed([flat, flat]), IngestConfig(), "unknown").frame_count == 2
