import json
import shutil
from datetime import UTC, datetime

import numpy as np
import pytest

from pipeline import store
from pipeline.model_folder import frames_of_model, read_model_folder, write_beside, write_robot
from schemas.errors import InputError
from schemas.manifest import Provenance
from stages.result import result_files


@pytest.fixture
def folder(samples, tmp_path):
    """What `reart fit` leaves: the model, and the artifacts of result and ingest in its workdir."""
    result, ingested = samples["result"], samples["ingested"]
    artifacts = {("result", "r1"): (result, result_files(result)), ("ingest", "i1"): (ingested, {})}
    for (stage, key), (artifact, files) in artifacts.items():
        provenance = Provenance(
            stage=stage,
            version=1,
            dataset="scans",
            sequence="box",
            key=key,
            parameters={},
            config={},
            upstream={"ingest": "i1"} if stage == "result" else {},
            seed=0,
            created=datetime.now(UTC),
            seconds={},
            peak_memory_mib=1,
            packages={},
        )
        store.publish(tmp_path / "workdir" / "scans" / "box" / f"{stage}-{key}", artifact, provenance, files)
    for name, content in result_files(result).items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


def test_the_frames_that_a_model_was_fitted_to_are_found_in_its_workdir(folder, samples):
    sequence = samples["ingested"].sequence
    for place in (folder, folder / "workdir" / "scans" / "box" / "result-r1"):
        frames = frames_of_model(place, read_model_folder(place))
        assert len(frames) == sequence.frame_count
        assert frames[1] == pytest.approx(sequence.to_input(sequence.frames()[1]))


def test_frames_of_another_model_or_lost_ones_are_not_taken(folder):
    result = read_model_folder(folder)
    (folder / "model.json").write_text((folder / "model.json").read_text() + "\n")
    assert frames_of_model(folder, result) is None
    shutil.rmtree(folder / "workdir" / "scans" / "box" / "ingest-i1")
    assert frames_of_model(folder / "workdir" / "scans" / "box" / "result-r1", result) is None


@pytest.mark.parametrize(
    ("field", "value", "complaint"),
    [
        ("labels", np.full(4, 2), "labels"),
        ("T_frame_canonical", np.zeros((3, 1, 4, 4)), "T_frame_canonical"),
        (
            "canonical_points",
            np.full((4, 3), 1e30, dtype=np.float32),
            r"canonical_points: found a number of size 1e\+30",
        ),
    ],
)
def test_arrays_that_do_not_fit_the_model_are_refused(folder, samples, field, value, complaint):
    np.savez(folder / "model.npz", **(samples["result"].arrays() | {field: value}))
    with pytest.raises(InputError, match=complaint):
        read_model_folder(folder)


def test_motions_that_are_not_rigid_are_refused(folder, samples):
    arrays = samples["result"].arrays()
    Ts = arrays["T_frame_canonical"]
    bent = Ts.copy()
    bent[..., 3, 0] = 1.0
    for wrong in (2 * Ts, bent):
        np.savez(folder / "model.npz", **(arrays | {"T_frame_canonical": wrong}))
        with pytest.raises(InputError, match="T_frame_canonical: found others than rigid motions"):
            read_model_folder(folder)


def test_pickled_arrays_are_refused(folder, samples):
    np.savez(folder / "model.npz", **(samples["result"].arrays() | {"labels": np.array([object()] * 4)}))
    with pytest.raises(InputError, match=r"model\.npz: cannot be read"):
        read_model_folder(folder)


def test_a_model_of_another_version_is_refused(folder):
    content = json.loads((folder / "model.json").read_text())
    (folder / "model.json").write_text(json.dumps(content | {"version": 2}))
    with pytest.raises(InputError, match=r"version: .*\(found 2\); expected a model of version 1"):
        read_model_folder(folder)


def test_the_first_file_is_written_last(tmp_path, monkeypatch):
    written = []
    monkeypatch.setattr("pipeline.model_folder.write_atomically", lambda path, content: written.append(path.name))
    write_beside(tmp_path, {"robot.urdf": b"", "meshes/a.stl": b"", "meshes/b.stl": b""})
    assert written[-1] == "robot.urdf"
    assert (tmp_path / "meshes").is_dir()


def test_meshes_of_an_earlier_robot_go_but_for_those_that_a_description_still_names(tmp_path):
    write_robot(tmp_path, {"robot.urdf": b"meshes/part_1.stl", "meshes/part_1.stl": b"1", "meshes/part_11.stl": b"1"})
    (tmp_path / "meshes" / "mine.stl").touch()
    write_robot(tmp_path, {"robot.xml": b"meshes/part_2.stl", "meshes/part_2.stl": b"2"})
    assert {path.name for path in (tmp_path / "meshes").iterdir()} == {"part_1.stl", "part_2.stl", "mine.stl"}
    write_robot(tmp_path, {"robot.urdf": b"meshes/part_2.stl"})
    assert {path.name for path in (tmp_path / "meshes").iterdir()} == {"part_2.stl", "mine.stl"}
