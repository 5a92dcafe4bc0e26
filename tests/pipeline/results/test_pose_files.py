import json

import numpy as np
import pytest

from pipeline.results.pose_files import TARGET_COLUMNS, pose_files, read_states, read_targets
from schemas.errors import InputError
from schemas.model_file import ModelFile, ModelPart
from schemas.pose import Pose
from stages.ingest.point_formats import read_cloud
from stages.kernels.labelling.colours import distinct_colours

HEADER = ",".join(TARGET_COLUMNS) + "\n"
MODEL = ModelFile(
    units="metre", frames=1, canonical_frame=0, root=0, parts=(ModelPart(id=0, name="box", point_count=1),), joints=()
)
STILL = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
SOURCE, TARGET = np.arange(6.0).reshape(2, 3), np.arange(6.0).reshape(2, 3) / 7 - 1


def written(tmp_path, name, content):
    path = tmp_path / name
    if isinstance(content, dict):
        np.savez(path, **content)
    else:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("suffix", ["csv", "json", "npz", "CSV"])
def test_targets_are_read_alike_from_every_format(tmp_path, suffix):
    content = {
        "csv": HEADER.replace(",", ", ")
        + "\n".join(",".join(map(repr, row)) for row in np.hstack([SOURCE, TARGET]).tolist()),
        "json": json.dumps({"source": SOURCE.tolist(), "target": TARGET.tolist()}),
        "npz": {"source": SOURCE, "target": TARGET},
    }[suffix.lower()]
    source, target = read_targets(written(tmp_path, f"t.{suffix}", content))
    np.testing.assert_array_equal(source, SOURCE)
    np.testing.assert_array_equal(target, TARGET)


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("t.txt", "", r"found \.txt, expected \.csv, \.json, \.npz"),
        ("t", "", "found no ending"),
        ("t.csv", "", "found the header '', expected 'source_x,source_y,"),
        ("t.csv", "x,y,z\n1,2,3\n", "found the header 'x,y,z', expected"),
        ("t.csv", "1,2,3,4,5,6\n", "found the header '1,2,3,4,5,6'"),
        ("t.csv", HEADER, "found 0 source points and 0 targets"),
        ("t.csv", HEADER + "1,2,3,4,5,6\n1,2,3\n", "line 3: found 3 values, expected 6"),
        ("t.csv", HEADER + "1,2,3,4,5,six\n", "line 2: found 'six', expected a number"),
        ("t.csv", HEADER + "1,2,3,4,5,6\n1,2,3,4,5,nan\n", "row 2: found NaN or infinity"),
        ("t.csv", b"\xff\xfe\x00", "cannot be read as text"),
        ("t.csv", '"' + "x" * 200_000, "cannot be read as CSV"),
        ("t.csv", "x" * 1000, "found the header '(x){80}', expected"),
        ("t.json", "", "cannot be read as JSON"),
        ("t.json", '{"source": [[1, 2, 3]', "cannot be read as JSON"),
        ("t.json", "[[1, 2, 3]]", r"found \[\[1, 2, 3\]\], expected an object"),
        ("t.json", '{"source": [[1, 2, 3]]}', "found source, expected source and target"),
        ("t.json", '{"source": [[1, 2, 3]], "target": [[1, 2]]}', r"target: found shape \(1, 2\), expected"),
        ("t.json", '{"source": [[1, 2, 3], [1, 2]], "target": []}', "source: found rows of different lengths"),
        (
            "t.json",
            '{"source": [["1", "2", "3"]], "target": [[1, 2, 3]]}',
            "source: found values that are no numbers",
        ),
        ("t.json", '{"source": [], "target": []}', "found 0 source points"),
        ("t.json", '{"source": [[1, 2, 3]], "target": [[1, 2, 3], [1, 2, 3]]}', "found 1 source points and 2 targets"),
        ("t.json", '{"source": [[1, 2, NaN]], "target": [[1, 2, 3]]}', "row 1: found NaN"),
        ("t.json", "[" * 900 + "]" * 900, "found .{1,40}, expected an object"),
        ("t.json", "[" * 100_000, "cannot be read as JSON"),
        ("t.json", '{"source": ' + "[" * 900 + "]" * 900 + ', "target": []}', "source: found"),
        ("t.json", '{"source": [[1' + "0" * 5000 + ', 2, 3]], "target": [[1, 2, 3]]}', "cannot be read as JSON"),
        ("t.json", '{"source": [[1' + "0" * 400 + ', 2, 3]], "target": [[1, 2, 3]]}', "source: found values that are"),
        ("t.json", '{"source": [], "source": [], "target": []}', "found 'source' a second time"),
        ("t.json", '{"' + "a" * 10_000 + '": 1}', "found a{80}, expected source and target"),
        ("t.npz", b"none", "cannot be read as .npz"),
        ("t.npz", {"points": SOURCE}, "found points, expected source and target"),
        ("t.npz", {"source": np.array([object()]), "target": TARGET}, "cannot be read as .npz"),
        ("t.npz", {"source": SOURCE, "target": TARGET + np.inf}, "row 1: found NaN or infinity"),
        (
            "t.npz",
            {"source": SOURCE.astype(complex), "target": TARGET},
            "source: found values that are no numbers",
        ),
    ],
)
def test_targets_that_cannot_be_used_are_one_line(tmp_path, name, content, complaint):
    path = written(tmp_path, name, content)
    with pytest.raises(InputError, match=complaint) as caught:
        read_targets(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(path))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="not found"):
        read_targets(tmp_path / "t.csv")


def test_a_folder_is_no_file(tmp_path):
    (tmp_path / "t.csv").mkdir()
    with pytest.raises(InputError, match=r"t\.csv: found a folder, expected a \.csv file"):
        read_targets(tmp_path / "t.csv")


def test_states_are_numbers_or_rotation_vectors(tmp_path):
    expected = {"hinge": 0.5, "ball": (0.1, -0.2, 1.0)}
    for name, content in (
        ("s.json", '{"hinge": 0.5, "ball": [0.1, -0.2, 1]}'),
        ("s.csv", "name,value\nhinge, 0.5\n\nball,0.1 -0.2 1\n"),
    ):
        states, T = read_states(written(tmp_path, name, content), MODEL)
        assert states == expected
        np.testing.assert_array_equal(T, np.eye(4))


def test_a_pose_is_read_back_as_it_was_written(tmp_path):
    T = ((0.0, -1.0, 0.0, 5.0), (1.0, 0.0, 0.0, 0.1), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    pose = Pose(
        model_digest=MODEL.digest, units="metre", states={"hinge": 1 / 3, "ball": (0.1, 0.2, 0.3)}, T_pose_root=T
    )
    files = pose_files(pose, TARGET, np.array([0, 3]))
    states, T_read = read_states(written(tmp_path, "pose.json", files["pose.json"]), MODEL)
    assert states == pose.states
    np.testing.assert_array_equal(T_read, T)
    np.testing.assert_allclose(read_cloud(written(tmp_path, "posed.ply", files["posed.ply"])).points, TARGET, rtol=1e-6)


def test_the_points_have_the_colours_of_the_scan_or_else_of_their_parts(tmp_path):
    pose = Pose(model_digest=MODEL.digest, units="metre", states={}, T_pose_root=STILL)
    colours = np.array([[1, 2, 3], [250, 0, 9]], dtype=np.uint8)
    by_scan = pose_files(pose, TARGET, np.array([0, 1]), colours)["posed.ply"]
    by_part = pose_files(pose, TARGET, np.array([0, 1]))["posed.ply"]
    assert np.array_equal(read_cloud(written(tmp_path, "a.ply", by_scan)).colours, colours)
    expected = (255 * distinct_colours(2)).round()
    assert np.array_equal(read_cloud(written(tmp_path, "b.ply", by_part)).colours, expected)


def test_posed_points_far_away_keep_their_digits(tmp_path):
    p = np.random.default_rng(0).uniform(size=(500, 3)) + [694386.212, 5155487.512, 381.036]
    pose = Pose(model_digest=MODEL.digest, units="metre", states={}, T_pose_root=STILL)
    for points, kind in ((p, b"double"), (p - p.mean(axis=0), b"float")):
        ply = pose_files(pose, points, np.zeros(500, dtype=np.int64))["posed.ply"]
        assert b"property " + kind + b" x\n" in ply
        read = read_cloud(written(tmp_path, "posed.ply", ply)).points
        np.testing.assert_allclose(read, points, rtol=0, atol=1e-4 if kind == b"float" else 0)


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("s.npz", "", r"expected \.csv, \.json"),
        ("s.csv", "hinge,0.5\n", "found the header 'hinge,0.5', expected 'name,value'"),
        ("s.csv", "name,value\nhinge,0.5\nhinge,0.6\n", "line 3: found the joint 'hinge' a second time"),
        ("s.csv", "name,value\nhinge,half\n", "line 2: found 'half', expected a number"),
        ("s.csv", "name,value\nhinge,1 2\n", "line 2: hinge: found .*, expected a number, or three"),
        ("s.csv", "name,value\nhinge,inf\n", "line 2: hinge: found .*, expected finite"),
        ("s.json", "3", "found 3, expected an object"),
        ("s.json", '{"hinge": "0.5"}', "hinge: found .*, expected a number"),
        ("s.json", '{"hinge": true}', "hinge: found .*, expected a number"),
        ("s.json", '{"hinge": NaN}', "hinge: found .*, expected finite"),
        ("s.json", '{"hinge": 1' + "0" * 400 + "}", "hinge: found .{1,60}, expected finite"),
        ("s.json", '{"hinge": -1e16}', "hinge: found .*, expected finite numbers up to 1e"),
        ("s.json", '{"hinge": null}', "hinge: found .*, expected a number"),
        ("s.json", '{"hinge": 1, "hinge": 2}', "found 'hinge' a second time"),
        ("s.json", '{"hinge": ' + "[" * 900 + "]" * 900 + "}", "hinge: found .{1,40}, expected a number"),
        ("s.json", "[" * 900 + "]" * 900, "found .{1,40}, expected an object"),
        ("s.json", "[" * 100_000, "cannot be read as JSON"),
        ("s.json", '{"hinge": 1' + "0" * 5000 + "}", "cannot be read as JSON"),
        ("s.json", '{"\\u001b[31m": "red"}', r"s\.json: '\\x1b\[31m': found .'red'., expected a number"),
        ("s.json", '{"hinge": "' + "a" * 10_000 + '"}', "hinge: found .{1,40}, expected a number"),
        ("s.json", '{"format": ' + "[" * 900 + "]" * 900 + "}", "recursion limit exceeded"),
        ("s.json", '{"format": "rearticulate/pose", "states": {"hinge": 1' + "0" * 400 + "}}", ": .*pose it anew"),
        ("s.json", '{"format": "rearticulate/pose", "T_pose_root": [[1e400, 0, 0, 0]]}', ": .*pose it anew"),
        ("s.csv", "name,value\n" + "x" * 200_000 + ",1\n", "cannot be read as CSV"),
        ("s.json", '{"format": "rearticulate/pose", "version": 2}', "version: .*expected a pose of version 1"),
    ],
)
def test_states_that_cannot_be_used_are_one_line(tmp_path, name, content, complaint):
    path = written(tmp_path, name, content)
    with pytest.raises(InputError, match=complaint) as caught:
        read_states(path, MODEL)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(path))


def test_a_pose_whose_base_is_no_rigid_motion_is_refused(tmp_path):
    pose = Pose(model_digest=MODEL.digest, units="metre", states={}, T_pose_root=STILL)
    content = json.loads(pose.model_dump_json()) | {"T_pose_root": (2 * np.eye(4)).tolist()}
    with pytest.raises(InputError, match="T_pose_root: found no rigid motion"):
        read_states(written(tmp_path, "pose.json", json.dumps(content)), MODEL)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"units": "millimetre"}, "units: found millimetre, expected metre as in the model"),
        ({"model_digest": "of another"}, "model_digest: found of another, the pose of another model"),
    ],
)
def test_the_pose_of_another_model_is_refused(tmp_path, change, complaint):
    pose = Pose(model_digest=MODEL.digest, units="metre", states={}, T_pose_root=STILL)
    path = written(tmp_path, "pose.json", pose.model_copy(update=change).model_dump_json())
    with pytest.raises(InputError, match=complaint):
        read_states(path, MODEL)
