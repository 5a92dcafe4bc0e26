import json
import subprocess
import sys

import numpy as np
import pytest

from stages.ingest.point_formats import read_cloud

HEADER = "source_x,source_y,source_z,target_x,target_y,target_z\n"


@pytest.fixture
def targets(model, tmp_path):
    """A hundred points of each of the first two parts, which the hinge has turned by 0.03; the last is not told."""
    arrays = np.load(model / "model.npz")
    p = arrays["canonical_points"][:200].astype(np.float64)
    joint = json.loads((model / "model.json").read_text())["joints"][0]
    axis, point = np.array(joint["axis"]), np.array(joint["point"])
    arm = p[100:] - point
    turned = p.copy()
    across = np.cross(axis, arm)
    turned[100:] = point + arm + np.sin(0.03) * across + (1 - np.cos(0.03)) * np.cross(axis, across)
    path = tmp_path / "targets.npz"
    np.savez(path, source=p, target=turned)
    return path


def test_targets_pose_a_model_and_what_they_do_not_tell_is_said(reart, model, targets, tmp_path):
    done = reart("pose", "chain", "--targets", targets, "--out", "posed")
    assert done.exit_code == 0
    assert "200 targets, missed by" in done.stdout
    [hinge, slider] = [line for line in done.stdout.splitlines() if "joint_" in line]
    assert "not told" in slider
    assert "not told" not in hinge
    pose = json.loads((tmp_path / "posed" / "pose.json").read_text())
    assert pose["states"] == {"joint_0_1": pytest.approx(0.03), "joint_1_2": pytest.approx(0, abs=1e-6)}
    assert pose["undetermined"] == ["joint_1_2"]
    p = read_cloud(tmp_path / "posed" / "posed.ply").points
    np.testing.assert_allclose(p[:200], np.load(targets)["target"], atol=1e-5)


def test_a_pose_that_was_found_is_posed_again_by_its_states(reart, model, targets, tmp_path):
    reart("pose", "chain", "--targets", targets, "--out", "first")
    done = reart("pose", model / "model.json", "--states", "first/pose.json", "--out", "second", "--json")
    assert done.exit_code == 0
    first, second = (json.loads((tmp_path / name / "pose.json").read_text()) for name in ("first", "second"))
    assert json.loads(done.stdout) == second
    assert second["states"] == first["states"]
    assert (tmp_path / "first" / "posed.ply").read_bytes() == (tmp_path / "second" / "posed.ply").read_bytes()


def test_the_pose_of_another_model_is_refused(reart, model, targets):
    reart("pose", "chain", "--targets", targets, "--out", "first")
    content = json.loads((model / "model.json").read_text())
    content["joints"][0]["upper"] += 1
    del content["json_sha256"]
    (model / "model.json").write_text(json.dumps(content))
    refused = reart("pose", "chain", "--states", "first/pose.json")
    assert refused.exit_code == 2
    assert "first/pose.json: model_digest: found " in refused.stderr


def test_without_out_nothing_is_written(reart, model, tmp_path):
    (tmp_path / "s.csv").write_text("name,value\njoint_0_1,0.1\n")
    before = sorted(tmp_path.rglob("*"))
    done = reart("pose", "chain", "--states", "s.csv")
    assert done.exit_code == 0
    assert "joint_1_2" in done.stdout
    assert sorted(tmp_path.rglob("*")) == before


def test_states_beyond_the_limits_want_a_word(reart, model, tmp_path):
    (tmp_path / "s.json").write_text('{"joint_0_1": 3}')
    refused = reart("pose", "chain", "--states", "s.json")
    assert refused.exit_code == 2
    assert "s.json: joint joint_0_1: found the state 3, expected one within its limits, -0.2 to 0.1" in refused.stderr
    assert reart("pose", "chain", "--states", "s.json", "--no-limits").exit_code == 0


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("chain",), "--targets, --states: found neither"),
        (("chain", "--targets", "t.csv", "--states", "s.json"), "--targets, --states: found both"),
        (("chain", "--states", "ok.json", "--free-base"), "--free-base, --fixed-base: found with --states"),
        (("chain", "--states", "ok.json", "--out", "artifact"), "--out artifact: found an artifact"),
        (("nowhere", "--states", "s.json"), "nowhere/model.json: not found"),
        (("chain/model.npz", "--states", "s.json"), "model.json: not found"),
        (("chain", "--states", "nowhere.json"), "nowhere.json: not found"),
        (("chain", "--targets", "t.csv"), "t.csv: row 2: found the source point (99, 0, 0)"),
        (("chain", "--states", "s.json"), "s.json: found the joint 'elbow', expected one of joint_0_1, joint_1_2"),
        (("chain", "--states", "ok.json", "--out", "t.csv"), "--out t.csv: found a file"),
        (("chain", "--states", "ok.json", "--out", "/proc/nothing"), "--out /proc/nothing: nothing can be written"),
    ],
)
def test_what_cannot_be_posed_is_one_line_and_exit_code_2(reart, model, tmp_path, words, complaint):
    (tmp_path / "t.csv").write_text(HEADER + "0,0,0,0,0,0\n99,0,0,0,0,0\n")
    (tmp_path / "s.json").write_text('{"elbow": 0.1}')
    (tmp_path / "ok.json").write_text("{}")
    (tmp_path / "artifact" / "arrays.zarr").mkdir(parents=True)
    (tmp_path / "artifact" / "manifest.json").touch()
    result = reart("pose", *words)
    assert result.exit_code == 2
    [error] = result.stderr.splitlines()
    assert complaint in error
    assert not (tmp_path / "posed").exists()


def test_it_starts_without_torch_and_open3d(model, targets):
    program = f"""
import sys
from typer.testing import CliRunner
from pipeline.cli import app
done = CliRunner().invoke(app, ["pose", {str(model)!r}, "--targets", {str(targets)!r}])
assert done.exit_code == 0, done.output
assert not {{"torch", "open3d", "matplotlib", "sklearn", "zarr"}} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_joint_named_by_markup_is_shown_as_it_is(reart, model):
    content = json.loads((model / "model.json").read_text())
    content["joints"][0]["name"] = "[/red]"
    del content["json_sha256"]
    (model / "model.json").write_text(json.dumps(content))
    (model / "states.json").write_text("{}")
    shown = reart("pose", "chain", "--states", "chain/states.json")
    assert (shown.exit_code, "[/red]" in shown.stdout) == (0, True)
