from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from schemas.config import IngestConfig
from stages.ingest.normalise import normalise
from stages.ingest.readers import Frame, read_frames

FAR = np.array([694386.212, 5155487.512, 381.036])


def hinges(count: int = 800, frames: int = 6) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    clouds = []
    for angle in np.linspace(0.2, 1.5, frames):
        c, s = np.cos(angle), np.sin(angle)
        plates = rng.random((2, count // 2, 3)) * [0.5, 0.5, 0]
        clouds.append(np.concatenate([plates[0], plates[1] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T]))
    return clouds


def warnings(clouds: list[np.ndarray], caplog: pytest.LogCaptureFixture) -> list[str]:
    caplog.clear()
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        normalise([Frame(f"{t}.ply", points) for t, points in enumerate(clouds)], IngestConfig(), "metre")
    return [record.message for record in caplog.records]


def test_coordinates_that_lost_their_digits_are_told_with_the_step(caplog: pytest.LogCaptureFixture) -> None:
    far = [points + FAR for points in hinges()]
    (message,) = warnings([points.astype(np.float32).astype(np.float64) for points in far], caplog)
    assert "lost their digits" in message
    assert "steps of 0.0625, 0.5, 3.05e-05 along x, y and z" in message
    (message,) = warnings([points.round(1) for points in far], caplog)
    assert "steps of 0.1, 0.1, 0.1" in message
    assert "points about 0.0" in message
    assert len(warnings([(points * 20).round() for points in hinges()], caplog)) == 1


def test_ordinary_clouds_are_not_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    clean = hinges()
    rounded = [points.round(6).astype(np.float32).astype(np.float64) for points in clean]
    flat = [points * [1, 1, 0] + [0, 0, 3] for points in clean]
    one_coarse = [clean[0].round(1), *clean[1:]]
    for clouds in (clean, rounded, flat, [points + FAR for points in clean], one_coarse):
        assert warnings(clouds, caplog) == []


def test_the_file_format_does_not_matter(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for t, points in enumerate(hinges()):
        np.savetxt(tmp_path / f"{t}.txt", points + FAR, fmt="%g")  # six digits
    (message,) = warnings([frame.points for frame in read_frames(tmp_path)], caplog)
    assert "steps of 1, 10, " in message
