"""Verdicts and spreads judged, on evaluations that are written here."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from pipeline.store import artifacts
from schemas.manifest import Provenance
from schemas.metrics import JointMetrics, Metrics


@pytest.fixture
def benchmark(load_benchmark):
    return load_benchmark("verdict")


def joint(error: float, spread: float | None) -> JointMetrics:
    return JointMetrics(
        name="hinge", true_type="revolute", predicted_type="revolute", axis_angle_deg=error, direction_spread_deg=spread
    )


def metrics(trust: str | None, ari: float | None, ted: int = 0, joints: tuple[JointMetrics, ...] = ()) -> Metrics:
    return Metrics(
        units="metre",
        diagonal=1.0,
        canonical_frame=0,
        parts_found=2,
        parts_true=2,
        chamfer_percent=0.5,
        trust=trust,
        ari=ari,
        tree_edit_distance=ted,
        joints=joints,
    )


@pytest.fixture
def write(tmp_path):
    """Publish an evaluation as a run does."""

    def published(dataset: str, sequence: str, value: Metrics, key: str = "0") -> None:
        provenance = Provenance(
            stage="evaluation", version=1, dataset=dataset, sequence=sequence, key=key, parameters={}, config={},
            upstream={}, seed=0, created=datetime(2026, 1, 1, tzinfo=UTC), seconds={}, packages={},
        )  # fmt: skip
        artifacts.publish(tmp_path / dataset / sequence / f"evaluation-{key}", value, provenance)

    return published


def test_wrong_and_good_models_are_counted_by_data_set(benchmark, write, tmp_path, capsys):
    write("urdf", "a", metrics("good", 0.95))
    write("urdf", "b", metrics("poor", 0.95, ted=1))
    write("urdf", "c", metrics("good", 0.5))
    write("urdf", "d", metrics("doubtful", 0.8))  # neither
    write("roboart", "e", metrics("doubtful", 0.9))
    write("roboart", "f", metrics(None, 0.1))  # of a release without verdicts
    assert benchmark.main([str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "urdf: 4 models; 2 wrong, 50% flagged; 1 good, 0% flagged" in told
    assert "roboart: 1 models; 0 wrong; 1 good, 100% flagged" in told
    assert "all: 5 models; 2 wrong, 50% flagged; 2 good, 50% flagged" in told


def test_the_newest_evaluation_of_a_sequence_counts(benchmark, write, tmp_path):
    write("urdf", "a", metrics("good", 0.95), key="1")
    write("urdf", "a", metrics("poor", 0.95), key="0")
    [model] = benchmark.judged_models(tmp_path)
    assert model.flagged


def test_shares_within_one_and_two_spreads_leave_out_what_has_none(benchmark):
    joints = [joint(0.5, 1.0), joint(1.5, 1.0), joint(2.5, 1.0), joint(0.1, 0.4), joint(9.0, None)]
    told = benchmark.spread_line(joints, "axis_angle_deg", "direction_spread_deg")
    assert told.startswith("4, 50% within one spread, 75% within two; ")
    assert f"median error {np.median([0.5, 1.5, 2.5, 0.1]):.2f}, median spread 1.00" in told
    assert benchmark.spread_line(joints, "place_percent", "place_spread_percent") == "none"


def test_where_there_is_no_verdict_that_is_said(benchmark, tmp_path, capsys):
    assert benchmark.main([str(tmp_path)]) == 2
    assert capsys.readouterr().err.endswith("found no verdict with ground truth, expected what `reart run` left\n")
