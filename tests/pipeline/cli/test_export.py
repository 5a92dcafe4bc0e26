import json

import pytest

from pipeline.results.delivery import check_delivery
from pipeline.run.task import upstream_first
from pipeline.run.tasks import ResultTask


def edit(folder, change):
    content = json.loads((folder / "model.json").read_text())
    del content["json_sha256"]
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
    done = reart("export", "chain", "--to", "urdf", "--scale", "0.05", "--mesh", "hull", "--out", "elsewhere/deep")
    assert done.exit_code == 0
    assert "an unknown unit) = 0.05 m" in (model.parent / "elsewhere" / "deep" / "robot.urdf").read_text()
    assert "--scale" not in done.stdout
    assert not (model / "robot.urdf").exists()


def test_meshes_that_no_export_wrote_or_that_were_changed_since_stay(reart, model):
    reart("export", "chain", "--to", "urdf", "--set", "export.triangles=50")
    (model / "meshes" / "part_3.stl").write_bytes(b"of the user's")
    (model / "meshes" / "part_0_collision.stl").write_bytes(b"mended by hand")
    record = json.loads((model / "delivered.json").read_text())
    assert set(record["files"]) == {
        "robot.urdf",
        *(f"meshes/part_{part}{role}.stl" for part in range(3) for role in ("", "_collision")),
    }
    reart("export", "chain", "--to", "urdf", "--set", "export.triangles=50")
    assert (model / "meshes" / "part_3.stl").read_bytes() == b"of the user's"
    assert check_delivery(model) == []


@pytest.mark.parametrize("command", ["export", "fit"])
def test_a_link_in_the_meshes_place_is_refused_and_nothing_behind_it_changes(reart, model, tmp_path, command):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "part_9.stl").write_bytes(b"mine")
    (model / "meshes").symlink_to(tmp_path / "mine")
    words = {"export": ("export", "chain", "--to", "urdf"), "fit": ("fit", "frames", "--out", "chain")}[command]
    result = reart(*words)
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "chain/meshes: found a symbolic link" in result.stderr
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["part_9.stl"]


def test_a_link_in_a_files_place_is_replaced_itself(reart, model, tmp_path):
    (tmp_path / "precious").write_text("precious")
    (model / "meshes").mkdir()
    for name in ("robot.urdf", "delivered.json", "meshes/part_0.stl"):
        (model / name).symlink_to(tmp_path / "precious")
    assert reart("export", "chain", "--to", "urdf", "--set", "export.triangles=50").exit_code == 0
    assert (tmp_path / "precious").read_text() == "precious"
    assert not (model / "robot.urdf").is_symlink()


def test_an_unknown_unit_is_said_to_be_taken_for_a_metre(reart, model):
    edit(model, lambda content: content.update(units="unknown"))
    assert "--scale" in reart("export", "chain", "--to", "urdf", "--set", "export.triangles=50").stdout


@pytest.mark.parametrize(
    ("units", "words", "complaint"),
    [
        ("unknown", (), "unit unknown: one unit was taken for one metre: the robot is "),
        ("metre", (), "the unit was said to be the metre: the robot is "),
        ("metre", ("--scale", "300"), "one unit was said to be 300 m: the robot is "),
        ("metre", ("--scale", "1e-4"), "one unit was said to be 0.0001 m: the robot is "),
        ("unknown", ("--scale", "0.1"), None),
        ("centimetre", (), None),
    ],
)
def test_an_absurd_size_is_said(reart, model, units, words, complaint):
    edit(model, lambda content: content.update(units=units))
    said = reart("export", "chain", "--to", "urdf", "--set", "export.triangles=50", *words).stdout
    assert (complaint or "\nwritten") in said
    assert ("kg heavy" in said) == (complaint is not None)


def cycle(content):
    content["joints"][0] |= {"parent": 2, "child": 1}
    content["joints"][1] |= {"parent": 1, "child": 2}


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (cycle, "found a cycle"),
        (lambda content: content.update(version=3), "version"),
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


def test_an_artifact_is_not_written_into(reart, evaluated):
    [task] = [task for task in upstream_first([ResultTask(job=evaluated.job("bolt"))]) if task.stage == "result"]
    before = sorted(task.directory.rglob("*"))
    result = reart("export", task.directory, "--to", "urdf")
    assert result.exit_code == 2
    assert "--out" in result.stderr
    assert sorted(task.directory.rglob("*")) == before
