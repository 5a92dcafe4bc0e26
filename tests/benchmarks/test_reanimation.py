import json
from datetime import UTC, datetime

import numpy as np
import pytest

from pipeline.store import artifacts
from schemas.config import EvaluationConfig, FinalFitConfig, PipelineConfig
from schemas.errors import InputError
from schemas.joints import PRISMATIC, REVOLUTE
from schemas.kinematic import CanonicalChoice
from schemas.manifest import Provenance
from schemas.sequence import GroundTruth, IngestedSequence, PointSequence, TrueJoint
from stages.evaluation.stage import compute_evaluation
from stages.kernels.kinematics.tree import KinematicTree
from stages.kernels.motion.rigid_motion import move_points

POINTS = 300  # of each box
HINGE, SLIDER = np.array([0.0, 0.3, -0.3, 0.5]), np.array([0.0, 0.05, 0.15, -0.1])
AXES, ANCHORS = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]), np.array([[0.175, 0.0, 0.0], [0.0, 0.0, 0.0]])


@pytest.fixture
def benchmark(load_benchmark):
    return load_benchmark("reanimation")


@pytest.fixture(scope="module")
def ingested():
    """A hinge between the first two of three boxes and a slider to the third, sampled anew in every frame."""
    rng = np.random.default_rng(0)
    tree = KinematicTree(
        kinds=(REVOLUTE, PRISMATIC),
        parent=np.array([0, 1]),
        child=np.array([1, 2]),
        axis=AXES,
        point=ANCHORS,
        root=0,
    )
    Ts = tree.Ts_pose_canonical(np.stack([HINGE, SLIDER], axis=1))
    labels = np.repeat([0, 1, 2], POINTS)
    frames = []
    for T in Ts:
        p = rng.uniform(-0.5, 0.5, (len(labels), 3))
        side = rng.integers(0, 3, len(p))
        p[np.arange(len(p)), side] = np.sign(p[np.arange(len(p)), side]) / 2
        frames.append(move_points(T[labels], p * [0.3, 0.2, 0.2] + 0.35 * labels[:, None] * [1, 0, 0]))
    count = len(frames)
    joints = [
        TrueJoint(name=name, parent=j, child=j + 1, type=name, axis=AXES[j], point=ANCHORS[j], states=tuple(states))
        for j, (name, states) in enumerate((("revolute", HINGE), ("prismatic", SLIDER)))
    ]
    return IngestedSequence(
        sequence=PointSequence(
            points=np.concatenate(frames),
            point_counts=np.full(count, len(labels)),
            dropped_counts=np.zeros(count, dtype=np.int64),
            scale=1.0,
            centre=(0.0, 0.0, 0.0),
            units="metre",
            frame_names=tuple(map(str, range(count))),
        ),
        truth=GroundTruth(
            labels=np.tile(labels, count),
            Ts_frame_first=Ts,
            Ts_novel_first=tree.Ts_pose_canonical(np.array([[0.4, 0.1], [-0.4, -0.05]])),
            parent=np.array([-1, 0, 1]),
            part_names=("a", "b", "c"),
            joints=tuple(joints),
        ),
    )


def finished_run(folder, ingested, model):
    """The artifacts that a run leaves of a sequence whose model this is."""
    metrics = compute_evaluation(model, ingested, EvaluationConfig(), np.random.default_rng(0))
    made = {
        "ingest": ingested,
        "canonical_frame": CanonicalChoice(candidates=(), model=model),
        "evaluation": metrics,
    }
    for stage, artifact in made.items():
        provenance = Provenance(
            stage=stage,
            version=1,
            dataset="scans",
            sequence="boxes",
            key="k",
            parameters={},
            config=json.loads(PipelineConfig().model_dump_json()),
            upstream={"ingest": "k", "canonical_frame": "k"} if stage == "evaluation" else {},
            seed=0,
            created=datetime.now(UTC),
            seconds={},
            peak_memory_mib=1,
            packages={},
        )
        artifacts.publish(folder / "scans" / "boxes" / f"{stage}-k", artifact, provenance, {})


def test_the_true_model_is_exact_and_its_joints_can_be_fitted_to_the_frames(benchmark, ingested):
    exact = benchmark.true_model(ingested, 1)
    assert exact.joint_types == ("revolute", "prismatic")
    assert exact.states_of(0)[:, 0] == pytest.approx(HINGE - HINGE[1])
    sampled = benchmark.fitted_to_frames(exact, ingested, FinalFitConfig())
    assert sampled.axis == pytest.approx(exact.axis, abs=0.03)
    assert not np.array_equal(sampled.axis, exact.axis)


def test_a_run_is_measured_and_kept(benchmark, ingested, tmp_path, capsys):
    exact = benchmark.true_model(ingested, 1)
    labels = exact.labels.copy()
    labels[POINTS : POINTS + 30] = 0  # a tenth of the middle box is taken for the first one's
    finished_run(tmp_path, ingested, exact.replace(labels=labels))
    assert benchmark.main([str(tmp_path), "--draws", "2", "--results", str(tmp_path)]) == 0
    [path] = tmp_path.glob("reanimation-*.json")
    record = benchmark.Record.model_validate_json(path.read_bytes())
    [entry] = record.sequences
    assert (entry.sequence, entry.parts_found, entry.tree_edit_distance, entry.parts_right) == ("boxes", 3, 0, True)
    assert entry.right_share == pytest.approx(1 - 30 / 900)
    assert entry.exact == pytest.approx(0, abs=1e-3)
    assert entry.fitted_on_right == pytest.approx(0, abs=1e-3)
    assert 0 < entry.sampled < entry.fitted
    text = path.with_suffix(".md").read_text()
    assert text in capsys.readouterr().out
    assert "| boxes | 3 of 3 | 0 | yes |" in text


def test_parts_that_share_few_points_are_not_right(benchmark):
    labels_true = np.repeat([0, 1], 10)
    labels = np.repeat([0, 1, 0], [10, 4, 6])
    assert benchmark.overlaps(labels, labels_true) == pytest.approx([10 / 16, 4 / 10])
    assert benchmark.rightly_labelled(labels, labels_true).tolist() == [True] * 14 + [False] * 6


def test_points_are_told_of_every_part_and_of_the_right_ones_where_there_are_any(benchmark):
    labels_true = np.repeat([0, 1], 10)
    among = np.arange(20) == 3
    given = list(benchmark.target_points(labels_true, among, 0, 4))
    assert {points[0] for points in given} == {3}
    assert len({points[1] for points in given}) > 1
    assert all(points[1] >= 10 for points in given)


def test_a_truth_without_joints_is_refused(benchmark, ingested):
    with pytest.raises(InputError, match="ground truth: found none with a joint"):
        benchmark.true_model(ingested.replace(truth=ingested.truth.replace(joints=())), 1)


def test_a_folder_without_a_run_is_refused(benchmark, tmp_path, capsys):
    assert benchmark.main([str(tmp_path)]) == 2
    assert "found nothing to measure" in capsys.readouterr().err
