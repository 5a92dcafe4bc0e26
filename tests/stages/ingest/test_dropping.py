from __future__ import annotations

import logging

import numpy as np
import pytest

from schemas.config import IngestConfig
from stages.ingest.dropping import kept_points
from stages.ingest.normalise import normalise, normalise_truth
from stages.ingest.readers import Frame
from stages.ingest.truth import RawTruth

RNG = np.random.default_rng(0)


def cloud(count: int = 800) -> np.ndarray:
    return RNG.uniform([-1, 2, 5], [3, 4, 6], size=(count, 3))


def dropped(points: np.ndarray) -> int:
    return int((~kept_points(Frame("frame", points))).sum())


@pytest.mark.parametrize("value", [[0.0, 0.0, 0.0], [0.3, -0.1, 7.5]])
@pytest.mark.parametrize("count", [40, 800, 100_000])
def test_many_points_at_one_place_are_dropped(value: list[float], count: int) -> None:
    points = cloud(count)
    points[::4] = value
    assert dropped(points) == count // 4
    assert kept_points(Frame("frame", points))[1::4].all()


def test_two_such_places_are_dropped_and_minus_zero_is_zero() -> None:
    points = cloud()
    points[:100], points[100:150], points[150:300] = 0.0, -0.0, [0, 0, 9]
    points[300:310] = np.nan
    assert dropped(points) == 310


def test_duplicates_of_ordinary_clouds_stay() -> None:
    points = cloud()
    few = np.concatenate([points, points[:1].repeat(5, axis=0)])
    twice = np.concatenate([points, points])
    drawn = points[RNG.integers(0, 800, 4096)]
    coarse = np.round(cloud(4096))
    vertices = cloud(60)[RNG.integers(0, 60, 4096)]
    for kept in (points, few, twice, drawn, coarse, vertices, np.ones((40, 3)), np.empty((0, 3))):
        assert dropped(kept) == 0


def test_the_warning_names_the_place_and_the_truth_loses_its_labels(caplog: pytest.LogCaptureFixture) -> None:
    points = [cloud(), cloud()]
    points[1][600:] = 0
    points[1][0] = np.nan
    frames = [Frame(f"{index}.ply", of_frame) for index, of_frame in enumerate(points)]
    truth = RawTruth(
        labels=[np.arange(800) % 2, np.arange(800) // 400],
        Ts_frame_first=np.tile(np.eye(4), (2, 2, 1, 1)),
        Ts_novel_first=np.empty((0, 2, 4, 4)),
        parent=np.array([-1, 0]),
        part_names=("a", "b"),
    )
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        sequence = normalise(frames, IngestConfig(), "unknown")
    assert sequence.dropped_counts.tolist() == [0, 201]
    assert sequence.points.shape == (1399, 3)
    (record,) = caplog.records
    assert "NaN or infinite coordinates or many at one and the same place (0, 0, 0)" in record.message
    assert "201 of 800 in 1.ply" in record.message
    labels = normalise_truth(truth, frames, sequence).labels
    np.testing.assert_array_equal(labels, np.concatenate([truth.labels[0], truth.labels[1][1:600]]))
