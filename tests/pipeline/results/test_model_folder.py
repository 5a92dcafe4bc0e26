import json
import shutil
from datetime import UTC, datetime

import numpy as np
import pytest

from pipeline.results.model_folder import ingested_of_model, read_model_folder
from pipeline.store import artifacts
from schemas.errors import InputError
from schemas.manifest import Provenance
from stages.result.stage import result_files


@pytest.fixture
def folder(samples, tmp_path):
    """What `reart fit` leaves: the model, and the artifacts of result and ingest in its workdir."""
    result, ingested = samples["result"], samples["ingested"]
    made = {("result", "r1"): (result, result_files(result)), ("ingest", "i1"): (ingested, {})}
    for (stage, key), (artifact, files) in made.items():
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
        artifacts.publish(tmp_path / "workdir" / "scans" / "box" / f"{stage}-{key}", artifact, provenance, files)
    for name, content in result_files(result).items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


def edit(folder, change):
    """Change model.json as by hand, without the digests that a fit put there."""
    content = json.loads((folder / "model.json").read_text())
    for name in ("json_sha256", "npz_sha256"):
        content.pop(name, None)
    change(content)
    (folder / "model.json").write_text(json.dumps(content))


def save(folder, **arrays):
    np.savez(folder / "model.npz", **arrays)
    edit(folder, lambda content: None)


def test_the_frames_that_a_model_was_fitted_to_are_found_in_its_workdir(folder, samples):
    sequence = samples["ingested"].sequence
    for place in (folder, folder / "workdir" / "scans" / "box" / "result-r1"):
        found = ingested_of_model(place, read_model_folder(place)).sequence
        assert found.frame_count == sequence.frame_count
        frames, colours = found.in_input()
        assert frames[1] == pytest.approx(sequence.to_input(sequence.frames()[1]))
        assert colours is None


def test_frames_of_another_model_or_lost_ones_are_not_taken(folder):
    result = read_model_folder(folder)
    (folder / "model.json").write_text((folder / "model.json").read_text() + "\n")
    assert ingested_of_model(folder, result) is None
    shutil.rmtree(folder / "workdir" / "scans" / "box" / "ingest-i1")
    assert ingested_of_model(folder / "workdir" / "scans" / "box" / "result-r1", result) is None


def test_a_damaged_sequence_is_not_taken_and_named(folder, caplog):
    [array] = (folder / "workdir" / "scans" / "box" / "ingest-i1").glob("arrays.zarr/sequence/points/c/*/*")
    array.write_bytes(b"x")
    assert ingested_of_model(folder, read_model_folder(folder)) is None
    [said] = caplog.messages
    assert "ingest-i1: arrays.zarr/sequence/points/" in said


def test_a_model_that_may_not_be_read_is_one_line(folder, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("pathlib.Path.read_bytes", refuse)
    with pytest.raises(InputError, match=r"model\.json: cannot be read \(Permission denied\)"):
        read_model_folder(folder)


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
    save(folder, **(samples["result"].arrays() | {field: value}))
    with pytest.raises(InputError, match=complaint):
        read_model_folder(folder)


def test_motions_that_are_not_rigid_are_refused(folder, samples):
    arrays = samples["result"].arrays()
    Ts = arrays["T_frame_canonical"]
    bent = Ts.copy()
    bent[..., 3, 0] = 1.0
    for wrong in (2 * Ts, bent):
        save(folder, **(arrays | {"T_frame_canonical": wrong}))
        with pytest.raises(InputError, match="T_frame_canonical: found others than rigid motions"):
            read_model_folder(folder)


def test_pickled_arrays_are_refused(folder, samples):
    save(folder, **(samples["result"].arrays() | {"labels": np.array([object()] * 4)}))
    with pytest.raises(InputError, match=r"model\.npz: cannot be read"):
        read_model_folder(folder)


def test_a_model_of_another_version_is_refused(folder):
    edit(folder, lambda content: content.update(version=3))
    with pytest.raises(InputError, match=r"version: .*\(found 3\); expected a model of version 1 or 2"):
        read_model_folder(folder)


def test_parts_of_other_counts_than_the_labels_are_refused(folder):
    edit(folder, lambda content: content["parts"][1].update(point_count=7))
    with pytest.raises(InputError, match=r"model\.json: parts\.1\.point_count: found 7, expected 2 as the labels"):
        read_model_folder(folder)


def test_a_model_of_an_earlier_release_tells_no_digests_and_is_read(folder, samples):
    edit(folder, lambda content: None)
    assert read_model_folder(folder).model == samples["result"].model


def test_every_flipped_byte_of_a_model_is_noticed(folder):
    rng = np.random.default_rng(0)
    for name in ("model.json", "model.npz"):
        content = (folder / name).read_bytes()
        for position in rng.choice(len(content), 150, replace=False):
            flipped = bytearray(content)
            flipped[position] ^= int(rng.integers(1, 256))
            (folder / name).write_bytes(flipped)
            with pytest.raises(InputError, match=r"model\.(json|npz): ") as caught:
                read_model_folder(folder)
            assert "\n" not in str(caught.value)
        (folder / name).write_bytes(content)
    read_model_folder(folder)


def test_a_model_with_the_arrays_of_another_is_refused(folder, samples):
    other = samples["result"].replace(labels=samples["result"].labels[::-1].copy())
    (folder / "model.npz").write_bytes(result_files(other)["model.npz"])
    with pytest.raises(InputError, match=r"model\.npz: damaged, or of another model"):
        read_model_folder(folder)


def test_a_result_artifact_is_checked_against_its_manifest(folder):
    artifact = folder / "workdir" / "scans" / "box" / "result-r1"
    read_model_folder(artifact)
    edit(artifact, lambda content: content["parts"][0].update(name="another"))
    with pytest.raises(InputError, match=r"result-r1: model\.json: its bytes were changed .*; compute it anew"):
        read_model_folder(artifact)


def test_who_changes_model_json_takes_its_digest_out(folder):
    content = (folder / "model.json").read_text().replace('"part_1"', '"door"')
    (folder / "model.json").write_text(content)
    with pytest.raises(InputError, match=r"its bytes were changed .* take the line json_sha256 out"):
        read_model_folder(folder)
    lines = [line for line in content.splitlines() if "json_sha256" not in line]
    (folder / "model.json").write_text("\n".join(lines))
    assert read_model_folder(folder).model.parts[1].name == "door"


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        '{"parts": ' + "[" * 100_000 + "]" * 100_000 + "}",
        '{"frames": 1' + "0" * 5000 + "}",
        '{"version": "' + "a" * 100_000 + '"}',
        "NaN",
        '{"joints": [{"lower": NaN}]}',
        b"\xff\xfe",
        "",
    ],
)
def test_a_model_json_that_cannot_be_used_is_one_short_line(folder, text):
    (folder / "model.json").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=r"model\.json: ") as caught:
        read_model_folder(folder)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(folder))
