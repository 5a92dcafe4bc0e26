from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree

from schemas.config import ArtefactsConfig, RoboartConfig
from schemas.sequence import NO_PART
from stages.ingest.roboart import build_from_urdf
from stages.ingest.roboart.artefacts import thinned_unevenly, with_outliers

SQUARE = np.random.default_rng(0).random((20_000, 3)) * [1, 1, 0]


def chosen(count=5000, seed=1, **options):
    return SQUARE[thinned_unevenly(SQUARE, count, ArtefactsConfig(**options), 1.0, np.random.default_rng(seed))]


def counts(points):
    """Points by cells of a grid."""
    return np.histogram2d(points[:, 0], points[:, 1], bins=10, range=[[0, 1], [0, 1]])[0]


def test_outliers_are_the_stated_share_in_and_around_the_box_and_belong_to_no_part():
    labels = np.ones(len(SQUARE), dtype=np.int64)
    box = SQUARE + [0, 0, 1] * np.random.default_rng(1).random((len(SQUARE), 1))
    points, found = with_outliers(box, labels, 0.1, np.random.default_rng(0))
    stray = found == NO_PART
    assert stray.mean() == pytest.approx(0.1, abs=0.01)
    assert set(found.tolist()) == {NO_PART, 1}
    np.testing.assert_array_equal(points[~stray], box[~stray])
    assert -0.2 <= points.min() < -0.15
    assert 1.15 < points.max() <= 1.2


def test_density_varies_smoothly_by_the_stated_spread_and_anew_in_each_scan():
    even, uneven, other = (
        counts(chosen()),
        counts(chosen(density_spread=0.8)),
        counts(chosen(2000, 2, density_spread=0.8)),
    )
    assert np.log(even).std() < 0.2
    assert 0.4 < np.log(uneven).std() < 1.2
    rough = np.log(uneven)
    neighbours = np.concatenate([np.diff(rough, axis=0).ravel(), np.diff(rough, axis=1).ravel()])
    assert neighbours.std() < 0.7 * np.sqrt(2) * rough.std()  # of a field that is not smooth as large as this root
    assert np.corrcoef(uneven.ravel(), other.ravel())[0, 1] < 0.7


def test_holes_are_round_patches_of_the_stated_radius_at_most():
    holed = chosen(20_000, holes=1, hole_radius=0.2)
    missing = 1 - len(holed) / len(SQUARE)
    assert np.pi * 0.1**2 / 4 < missing < 1.05 * np.pi * 0.2**2
    gone = KDTree(holed).query(SQUARE)[0]
    assert 0.1 * 0.8 < gone.max() <= 0.2
    assert KDTree(chosen(20_000)).query(SQUARE)[0].max() == 0


def test_a_piece_of_the_table_lies_below_and_belongs_to_no_part(arm):
    config = RoboartConfig(points=2000, frames=3, artefacts=ArtefactsConfig(table_size=0.5))
    frames, truth, _ = build_from_urdf(arm, (), config, np.random.default_rng(0))
    whole = build_from_urdf(arm, (), RoboartConfig(points=2000, frames=3), np.random.default_rng(0))[0]
    low, high = np.concatenate(whole).min(axis=0), np.concatenate(whole).max(axis=0)
    lowest = np.min([p[labels >= 0, 2].min() for p, labels in zip(frames, truth.labels, strict=True)])
    for points, labels in zip(frames, truth.labels, strict=True):
        table = points[labels == NO_PART]
        assert 100 < len(table) < 1000
        assert np.ptp(table[:, 2]) < 1e-12
        assert lowest - 0.01 < table[0, 2] <= lowest
        radius = np.linalg.norm(table[:, :2] - (low + high)[:2] / 2, axis=1)
        assert radius.max() == pytest.approx(0.25 * np.linalg.norm(high - low), rel=0.1)
        assert len(points) == 2000
    assert set(np.concatenate(truth.labels)) == {NO_PART, 0, 1, 2, 3, 4}


def test_all_artefacts_together_leave_the_truth_as_it_is(arm):
    artefacts = ArtefactsConfig(outlier_share=0.02, table_size=0.8, density_spread=0.5, holes=3)
    options = {"points": 300, "frames": 4, "viewpoints": 3, "noise_percent": 0.1, "coordinates": "upright"}
    config = RoboartConfig(artefacts=artefacts, **options)
    frames, truth, _ = build_from_urdf(arm, (), config, np.random.default_rng(0))
    plain = build_from_urdf(arm, (), RoboartConfig(**options), np.random.default_rng(0))[1]
    assert [len(frame) for frame in frames] == [300] * 4
    assert len(set(map(bytes, frames))) == 4
    np.testing.assert_array_equal(truth.Ts_frame_first, plain.Ts_frame_first)
    assert truth.joints == plain.joints
