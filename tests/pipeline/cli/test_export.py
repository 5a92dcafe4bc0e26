import json
import shutil

import pytest

from pipeline.task import upstream_first
from pipeline.tasks import ResultTask


def edit(folder, change):
    content = json.loads((folder / "model.json").read_text())
    change(content)
    (folder / "model.json").write_text(json.dumps(content))


@pytest.mark.parametrize(("format_", "file"), [("urdf", "robot.urdf"), ("mjcf", "robot.xml")])
def test_a_model_is_exported_beside_itself(reart, model, format_, file):
    done = reart("export", "chain", "--to", format_, "--set", "export.triangles=50")
    assert done.exit_code == 0
    assert f"written: chain/{file}" in done.stdout
    assert "the canonical frame only" in done.stdout
    text = (model / file).read_text()
    assert 'name="part_2"' in text
    assert {path.name for path in (model / "meshes").iterdir()} == {
        f"part_{part}{role}.stl" for part in range(3) for role in ("", "_collision")
    }


def test_another_folder_and_scale_may_be_given(reart, model):
    edit(model, lambda content: content.update(units="unknown"))
    done = reart("export", "chain", "--to", "urdf", "--scale", "0.5", "--mesh", "hull", "--out", "elsewhere/deep")
    assert done.exit_code == 0
    assert "an unknown unit) = 0.5 m" in (model.parent / "elsewhere" / "deep" / "robot.urdf").read_text()
    assert "--scale" not in done.stdout
    assert not (model / "robot.urdf").exists()


def test_the_meshes_of_an_earlier_export_with_more_parts_go(reart, model):
    reart("export", "chain", "--to", "urdf", "--set", "export.triangles=50")
    (model / "meshes" / "part_3.stl").write_bytes(b"of an earlier model")
    reart("export", "chain", "--to", "urdf", "--set", "export.triangles=50")
    assert not (model / "meshes" / "part_3.stl").exists()
    assert (model / "meshes" / "part_2.stl").exists()


def test_an_unknown_unit_is_said_to_be_taken_for_a_metre(reart, model):
    edit(model, lambda content: content.update(units="unknown"))
    assert "--scale" in reart("export", "chain", "--to", "urdf", "--set", "export.triangles=50").stdout


def cycle(content):
    content["joints"][0] |= {"parent": 2, "child": 1}
    content["joints"][1] |= {"parent": 1, "child": 2}


def spherical(content):
    content["joints"][0].update(type="spherical", states=[[0.0, 0.0, 0.0]] * 3)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (cycle, "found a cycle"),
        (lambda content: content.update(version=2), "version"),
        (spherical, "chain: joint joint_0_1: found a spherical joint"),
        (lambda content: content["joints"][0].update(states=[0.0]), "joint_0_1"),
        (lambda content: content["joints"][0].update(axis=[0.0, 0.0, 0.0]), "joint_0_1"),
        (lambda content: content["parts"].pop(), "expected a tree over 2 parts"),
        (lambda content: content.update(frames=7), "expected one for each of 7 frames"),
    ],
)
def test_a_model_that_cannot_be_exported_is_one_line(reart, model, change, complaint):
    edit(model, change)
    result = reart("export", "chain", "--to", "urdf")
    assert result.exit_code == 2
    [error] = result.stderr.splitlines()
    assert complaint in error
    assert not (model / "robot.urdf").exists()


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("nowhere", "--to", "urdf"), "nowhere/model.json: not found"),
        (("chain", "--to", "sdf"), "--to: found 'sdf', expected one of urdf, mjcf"),
        *(
            (("chain", "--to", "urdf", "--scale", scale), f"error: --scale: found {float(scale)}")
            for scale in ("0", "-1", "nan", "inf", "1e300", "1e-300")
        ),
        (("chain", "--to", "urdf", "--mesh", "fine"), "error: --mesh: found 'fine'"),
        (("chain", "--to", "urdf", "--collision", "boxes"), "error: --collision: found 'boxes'"),
        (("chain", "--to", "urdf", "--set", "export.metres_per_unit=0"), "export.metres_per_unit: found 0"),
        (("chain", "--to", "urdf", "--out", "chain/model.json"), "--out chain/model.json: found a file"),
    ],
)
def test_options_that_cannot_be_used_are_one_line(reart, model, words, complaint):
    result = reart("export", *words)
    assert result.exit_code == 2
    [error] = result.stderr.splitlines()
    assert complaint in error


def test_a_model_without_its_arrays_is_one_line(reart, model):
    (model / "model.npz").unlink()
    result = reart("export", "chain", "--to", "urdf")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "model.npz: not found" in result.stderr


def test_an_artifact_is_not_written_into(reart, model, evaluated):
    [task] = [task for task in upstream_first([ResultTask(job=evaluated.job("bolt"))]) if task.stage == "result"]
    for name in ("model.json", "model.npz"):
        shutil.copy(model / name, task.directory)
    before = sorted(task.directory.rglob("*"))
    result = reart("export", task.directory, "--to", "urdf")
    assert result.exit_code == 2
    assert "--out" in result.stderr
    assert sorted(task.directory.rglob("*")) == before
    shutil.rmtree(task.directory)
