"""`reart fit`: killed, interrupted and resumed; its files; bad input; a user's own stage function."""

import signal

import numpy as np
import pytest

from pipeline.results.delivery import check_delivery
from schemas.metrics import Metrics
from schemas.model_file import ModelFile

FIT = ("fit", "data/box", "--out", "out")
PLY = b"ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
OWN_FLOW = """
import os, signal

def killed(frames, config, rng, progress):
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module")
def fitted(finished, tmp_path_factory):
    """A fit that was killed, then interrupted, then left in peace; what was complete is checked at each turn."""
    place = type(finished)(tmp_path_factory.mktemp("fitted"), workdir_name="out/workdir")
    (place.folder / "data").symlink_to(finished.folder / "data")
    complete = {}
    for moment, blow, code in (("ingest", signal.SIGKILL, -9), ("flow", signal.SIGINT, 130)):
        started = place.start(*FIT, "--workers", "2")
        started.wait_for(moment)
        assert started.end(blow) == code
        assert complete.items() <= place.times().items()
        complete = place.times()
    assert 2 <= len(complete) < len(finished.manifests())
    assert place.hidden() == []
    assert not (place.folder / "out" / "model.json").exists()
    outcome = place.reart(*FIT, "--workers", "1", "--truth", "data/box/ground_truth.npz")
    assert (outcome.returncode, outcome.stderr) == (0, "")
    assert complete.items() <= place.times().items()
    return type(finished)(place.folder, place.workdir_name, outcome)


def test_what_was_killed_and_resumed_is_what_an_undisturbed_run_makes(finished, fitted):
    assert fitted.contents() == finished.contents()
    assert fitted.hidden() == []


def test_fit_writes_the_contracts_files(fitted):
    out = fitted.folder / "out"
    files = ["metrics.json", "model.json", "model.npz", "report.html", "robot.urdf", "robot.xml"]
    assert sorted(path.name for path in out.iterdir()) == ["delivered.json", "meshes", *files, "workdir"]
    assert check_delivery(out) == []
    model = ModelFile.model_validate_json((out / "model.json").read_bytes())
    meshes = {f"part_{part.id}{role}.stl" for part in model.parts for role in ("", "_collision")}
    assert {path.name for path in (out / "meshes").iterdir()} == meshes
    assert (model.units, model.frames) == ("unknown", 3)
    with np.load(out / "model.npz") as arrays:
        assert arrays["canonical_points"].dtype == np.float32
        given = np.load(fitted.folder / "data" / "box" / f"frame_{model.canonical_frame}.npy")
        assert np.allclose(arrays["canonical_points"], given, atol=1e-6)
        assert arrays["labels"].shape == (200,)
        assert arrays["T_frame_canonical"].shape == (3, len(model.parts), 4, 4)
        assert np.array_equal(np.bincount(arrays["labels"]), [part.point_count for part in model.parts])
    assert Metrics.model_validate_json((out / "metrics.json").read_bytes()).parts_true == 2
    written = fitted.outcome.stdout.partition("written in ")[2]
    named = written.partition(": ")[2].replace(",", "").split()
    assert sorted(named) == sorted(f"out/{name}" for name in ("meshes/", "delivered.json", *files))


def test_a_killed_stage_is_reported_with_its_log_and_a_warning_is_shown(fresh):
    (fresh.folder / "mine.py").write_text(OWN_FLOW)
    (fresh.folder / "stages").mkdir()  # a folder of the user's that has the name of ours
    (fresh.folder / "stages" / "__init__.py").write_text("raise SystemError('not this one')")
    frame = fresh.folder / "data" / "box" / "frame_1.npy"
    points = np.load(frame)
    points[:2] = np.nan
    np.save(frame, points)
    outcome = fresh.reart(*FIT, "--set", "flow.estimator=mine:killed")
    assert outcome.returncode == 1
    assert "warning: box ingest: dropped 2 points" in outcome.stdout
    [error] = outcome.stderr.splitlines()
    assert error.startswith("error: box flow: its process ended without a word: killed by SIGKILL")
    assert not (fresh.folder / "out" / "model.json").exists()
    assert list(fresh.folder.glob("out/workdir/scans/box/ingest-*/manifest.json"))  # what was complete is kept


def write_truncated_ply(folder):
    for frame in folder.glob("frame_*.npy"):
        frame.unlink()
    (folder / "frame_0.ply").write_bytes(PLY % 40 + b"0 0 1\n" * 40)
    (folder / "frame_1.ply").write_bytes(PLY % 99 + b"0 0 1\n" * 40)


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda folder: [path.unlink() for path in folder.iterdir()], "box"),
        (lambda folder: [(folder / f"frame_{t}.npy").unlink() for t in (1, 2)], "box"),
        (lambda folder: np.save(folder / "frame_1.npy", np.ones((100, 3))), "frame_1.npy"),
        (lambda folder: np.save(folder / "frame_1.npy", np.ones((3, 3))), "frame_1.npy"),
        (write_truncated_ply, "frame_1.ply"),
    ],
)
def test_bad_input_is_one_clear_line_and_exit_code_2(fresh, spoil, complaint):
    spoil(fresh.folder / "data" / "box")
    outcome = fresh.reart(*FIT)
    assert outcome.returncode == 2
    [error] = outcome.stderr.splitlines()
    assert error.startswith("error: ")
    assert complaint in error
