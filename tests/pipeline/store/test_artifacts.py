import json
import os
import shutil
import subprocess
import sys
import textwrap
import threading
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import zarr

from pipeline.store import artifacts
from pipeline.store.arrays import arrays_of, payload_of
from schemas.manifest import Provenance
from schemas.sequence import PointSequence

NAME = "flow-0123456789abcdef"


def provenance(**changes):
    values = {
        "stage": "flow",
        "version": 1,
        "dataset": "scans",
        "sequence": "box",
        "key": "0123456789abcdef",
        "parameters": {"candidate": 0},
        "config": {"seed": 0},
        "upstream": {"ingest": "fedcba9876543210"},
        "seed": 0,
        "created": datetime.now(UTC),
        "seconds": {"read": 0.1, "compute": 0.2},
        "packages": {"numpy": "2"},
    }
    return Provenance.model_validate(values | changes)


@pytest.fixture
def place(tmp_path):
    """Where an artifact belongs: workdir/dataset/sequence/stage-key."""
    return tmp_path / "scans" / "box" / NAME


@pytest.fixture
def stored(place, samples):
    artifacts.publish(place, samples["ingested"], provenance(), {"model.json": b"{}"})
    return place


def same(a, b):
    arrays_a, arrays_b = ({name: array for name, _, array in arrays_of(x)} for x in (a, b))
    return (
        type(a) is type(b)
        and payload_of(a) == payload_of(b)
        and arrays_a.keys() == arrays_b.keys()
        and all(
            arrays_a[name].dtype == arrays_b[name].dtype and np.array_equal(arrays_a[name], arrays_b[name])
            for name in arrays_a
        )
    )


def refusal(directory, schema):
    with pytest.raises(artifacts.CorruptArtifactError) as caught:
        artifacts.read(directory, schema)
    message = str(caught.value)
    assert "\n" not in message
    assert str(directory) in message
    assert "rerun" in message
    return message


def files_of(directory):
    return sorted(path for path in directory.rglob("*") if path.is_file())


def left_over(place):
    return [path.name for path in place.parent.glob(".*")]


def flip(path, offset, bit=0):
    data = bytearray(path.read_bytes())
    data[offset] ^= 1 << bit
    path.write_bytes(data)


def test_every_schema_survives_the_round_trip(place, sample):
    artifacts.publish(place, sample, provenance())
    assert same(artifacts.read(place, type(sample)), sample)
    assert left_over(place) == []


def test_the_manifest_tells_where_an_artifact_came_from_and_what_it_holds(stored, samples):
    manifest = artifacts.read_manifest(stored)
    assert (manifest.upstream, manifest.config) == ({"ingest": "fedcba9876543210"}, {"seed": 0})
    table = {entry.name: entry for entry in manifest.arrays}
    points = table["sequence/points"]
    assert (points.dtype, points.shape, points.dims, points.unit) == (
        "float64",
        (12, 3),
        ("all_points", "3"),
        "normalised",
    )
    assert set(manifest.files) == {str(p.relative_to(stored)) for p in files_of(stored)} - {"manifest.json"}
    assert manifest.payload["truth"]["part_names"] == ["base", "lid"]


def test_frames_are_chunks_and_each_array_is_one_shard(place, samples):
    rows = 70_000
    counts = np.array([rows])
    long = PointSequence(
        points=np.zeros((rows, 3)), point_counts=counts, dropped_counts=0 * counts, scale=1.0, centre=(0, 0, 0),
        units="unknown", frame_names=("a",),
    )  # fmt: skip
    artifacts.publish(place, long, provenance())
    array = zarr.open_group(place / "arrays.zarr", mode="r")["points"]
    assert (array.chunks, array.nchunks_initialized) == ((65_536, 3), 2)  # though all of it is the fill value
    shutil.rmtree(place)
    artifacts.publish(place, samples["kinematic"], provenance())
    array = zarr.open_group(place / "arrays.zarr", mode="r")["Ts_frame_canonical"]
    assert (array.chunks, array.shards) == ((1, 3, 4, 4), (3, 3, 4, 4))


def test_a_flipped_byte_in_any_array_file_is_reported(stored, samples):
    schema = type(samples["ingested"])
    files = [path for path in files_of(stored) if path.name != "manifest.json"]
    assert len(files) > 10
    for path in files:
        original = path.read_bytes()
        for offset in range(0, len(original), max(1, len(original) // 12)):
            flip(path, offset, bit=offset % 8)
            assert str(path.relative_to(stored)) in refusal(stored, schema)
            path.write_bytes(original)
    assert same(artifacts.read(stored, schema), samples["ingested"])


def test_no_flipped_byte_gives_other_values_even_past_the_files_digests(stored):
    manifest = artifacts.read_manifest(stored)
    entry = next(entry for entry in manifest.arrays if entry.name == "sequence/points")
    expected = artifacts.read_entry(stored, entry, artifacts.read_contents(stored))
    caught = 0
    for path in files_of(stored / "arrays.zarr" / "sequence" / "points"):
        original = path.read_bytes()
        for offset in range(0, len(original), 7):
            flip(path, offset, bit=offset % 8)
            try:
                assert np.array_equal(artifacts.read_entry(stored, entry, artifacts.read_contents(stored)), expected)
            except artifacts.CorruptArtifactError:
                caught += 1
            path.write_bytes(original)
    assert caught > 50


def test_a_missing_chunk_is_reported_and_never_read_as_zeros(stored, samples):
    entry = next(entry for entry in artifacts.read_manifest(stored).arrays if entry.name == "sequence/points")
    chunk = stored / "arrays.zarr" / "sequence" / "points" / "c" / "0" / "0"
    chunk.unlink()
    assert "c/0/0: missing" in refusal(stored, type(samples["ingested"]))
    with pytest.raises(artifacts.CorruptArtifactError, match="chunks are missing"):
        artifacts.read_entry(stored, entry, artifacts.read_contents(stored))


def test_a_file_too_many_is_reported(stored, samples):
    (stored / "model.npz").write_bytes(b"")
    assert "model.npz: not part" in refusal(stored, type(samples["ingested"]))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.999])
def test_a_truncated_manifest_is_reported(stored, samples, share):
    manifest = stored / "manifest.json"
    manifest.write_bytes(manifest.read_bytes()[: int(share * manifest.stat().st_size)])
    assert "manifest.json" in refusal(stored, type(samples["ingested"]))


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content["payload"]["sequence"].update(scale=1.8),
        lambda content: content.update(seed=1),
        lambda content: content.update(extra=1),
        lambda content: content.pop("upstream"),
        lambda content: content.update(schema_version=2),
    ],
)
def test_a_changed_manifest_is_reported(stored, samples, change):
    manifest = stored / "manifest.json"
    content = json.loads(manifest.read_text())
    change(content)
    manifest.write_text(json.dumps(content))
    assert "manifest.json" in refusal(stored, type(samples["ingested"]))


def test_an_artifact_of_another_place_or_kind_is_reported(stored, samples):
    moved = stored.with_name("flow-ffffffffffffffff")
    os.rename(stored, moved)
    assert "belongs to flow-0123456789abcdef" in refusal(moved, type(samples["ingested"]))
    os.rename(moved, stored)
    assert "not a Flow" in refusal(stored, type(samples["flow"]))


def test_what_has_no_manifest_is_neither_complete_nor_read(stored, samples):
    assert artifacts.completed_at(stored) is not None
    (stored / "manifest.json").unlink()
    assert artifacts.completed_at(stored) is None
    assert "manifest.json" in refusal(stored, type(samples["ingested"]))
    artifacts.publish(stored, samples["flow"], provenance())
    assert same(artifacts.read(stored, type(samples["flow"])), samples["flow"])
    assert left_over(stored) == []


def test_a_losing_racer_keeps_the_winners_artifact(stored, samples):
    before = artifacts.completed_at(stored)
    artifacts.publish(stored, samples["ingested"], provenance(seed=7))
    assert artifacts.completed_at(stored) == before
    assert artifacts.read_manifest(stored).seed == 0
    assert left_over(stored) == []


def test_racing_writers_leave_one_whole_artifact(place, samples):
    start = threading.Barrier(4)

    def write():
        start.wait()
        artifacts.publish(place, samples["ingested"], provenance())

    threads = [threading.Thread(target=write) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert same(artifacts.read(place, type(samples["ingested"])), samples["ingested"])
    assert left_over(place) == []


def test_only_the_artifact_that_a_rerun_means_gives_way(stored, samples):
    old = artifacts.completed_at(stored)
    artifacts.publish(stored, samples["ingested"], provenance(seed=7), replaces=old + 1)
    assert artifacts.read_manifest(stored).seed == 0
    artifacts.publish(stored, samples["ingested"], provenance(seed=8), replaces=old)
    assert artifacts.read_manifest(stored).seed == 8
    assert left_over(stored) == []


def test_a_failed_write_leaves_nothing(place, samples, monkeypatch):
    def full(path: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(artifacts, "_sync", full)
    with pytest.raises(OSError, match="No space"):
        artifacts.publish(place, samples["flow"], provenance())
    assert list(place.parent.iterdir()) == []


KILLED_WRITER = textwrap.dedent(
    """
    import importlib.util, os, shutil, signal, sys, zarr
    from pathlib import Path
    from pipeline.store import artifacts

    def load(path):
        spec = importlib.util.spec_from_file_location(Path(path).stem, path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    tests, workdir = Path(sys.argv[1]), Path(sys.argv[2])
    flow = load(tests / "conftest.py").flow
    provenance = load(tests / "pipeline" / "store" / "test_artifacts.py").provenance

    def die_at(call, replaces, directory):
        calls = 0
        def counted(function):
            def wrapper(*arguments, **named):
                nonlocal calls
                calls += 1
                if calls == call:
                    os.kill(os.getpid(), signal.SIGKILL)
                return function(*arguments, **named)
            return wrapper
        for module, name in (
            (artifacts, "pack"), (artifacts, "sha256"), (artifacts, "_sync"), (os, "rename"), (shutil, "rmtree"),
            (Path, "mkdir"), (Path, "write_bytes"), (Path, "write_text"), (zarr.Group, "create_array"),
        ):
            setattr(module, name, counted(getattr(module, name)))
        artifacts.publish(directory, flow(), provenance(seed=call), replaces=replaces)
        os._exit(0)

    for call in range(1, 100):
        directory = workdir / str(call) / "box" / "flow-0123456789abcdef"
        replaces = None
        if len(sys.argv) > 3:
            shutil.copytree(sys.argv[3], directory)
            replaces = artifacts.completed_at(directory)
        child = os.fork()
        if child == 0:
            die_at(call, replaces, directory)
        if os.waitpid(child, 0)[1] == 0:
            break
    """
)


@pytest.mark.parametrize("mode", ["new", "replacing"])
def test_a_writer_killed_at_any_step_loses_nothing_and_publishes_no_half(tmp_path, samples, mode):
    tests, old, workdir = Path(__file__).parents[2], tmp_path / "old" / NAME, tmp_path / "workdir"
    artifacts.publish(old, samples["flow"], provenance())
    arguments = [tests, workdir, *([old] if mode == "replacing" else [])]
    subprocess.run([sys.executable, "-c", KILLED_WRITER, *map(str, arguments)], check=True, timeout=60)
    attempts = sorted(workdir.iterdir(), key=lambda path: int(path.name))
    assert len(attempts) > 10
    schema = type(samples["flow"])
    assert not all(
        (attempt / "box" / NAME).exists() for attempt in attempts
    )  # some were killed before or between renames
    artifacts.sweep(workdir)
    for attempt in attempts:
        place = attempt / "box" / NAME
        assert left_over(place) == []
        if mode == "new" and not place.exists():
            artifacts.publish(place, samples["flow"], provenance())
        assert same(artifacts.read(place, schema), samples["flow"])


def test_a_sweep_spares_a_living_writer_of_another_process(tmp_path, place):
    program = textwrap.dedent(
        """
        import sys
        from pathlib import Path
        from pipeline.store import artifacts
        with artifacts._staging(Path(sys.argv[1])) as staged:
            print(staged, flush=True)
            sys.stdin.readline()
        """
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(place)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as writer:
        staged = Path(writer.stdout.readline().strip())
        artifacts.sweep(tmp_path)
        assert staged.is_dir()
        writer.kill()
        writer.wait()
        assert staged.is_dir()
        artifacts.sweep(tmp_path)
        assert not staged.exists()


def test_a_sweep_removes_what_killed_writers_of_records_left(stored):
    partial = stored.with_name(".0123456789ab.reart-partial")
    partial.write_text("half")
    artifacts.sweep(stored.parents[2])
    assert not partial.exists()


def test_a_sweep_touches_nothing_else(stored):
    kept = [stored.parent / "flow-0123456789abcdef.log", stored.parent / ".hidden"]
    for path in kept:
        path.write_text("")
    artifacts.sweep(stored.parents[2])
    assert all(path.exists() for path in [stored, *kept])


def unreadable(directory, schema):
    with pytest.raises(artifacts.UnreadableArtifactError) as caught:
        artifacts.read(directory, schema)
    assert "remove" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("error", [MemoryError(), PermissionError(13, "Permission denied"), OSError(24, "Too many")])
def test_what_this_process_could_not_read_is_not_called_corrupt(stored, samples, monkeypatch, error):
    def fail(path):
        raise error

    monkeypatch.setattr(Path, "read_bytes", fail)
    assert str(stored) in unreadable(stored, type(samples["ingested"]))


@pytest.mark.parametrize("error", [MemoryError("too much"), RuntimeError("can't start new thread")])
def test_neither_is_what_it_could_not_unpack(stored, samples, monkeypatch, error):
    def fail(files, entry):
        raise error

    monkeypatch.setattr(artifacts, "read_array", fail)
    assert str(error) in unreadable(stored, type(samples["ingested"]))


def test_a_folder_inside_that_cannot_be_listed_is_not_taken_for_missing_files(stored, samples, monkeypatch):
    listed = os.scandir

    def scandir(path):
        if "arrays.zarr" in str(path):
            raise PermissionError(13, "Permission denied", str(path))
        return listed(path)

    monkeypatch.setattr(os, "scandir", scandir)
    assert "Permission denied" in unreadable(stored, type(samples["ingested"]))


def test_a_folder_that_cannot_be_looked_into_is_neither_complete_nor_missing(tmp_path):
    (tmp_path / "flow-0").symlink_to("flow-0")
    with pytest.raises(artifacts.UnreadableArtifactError, match="Too many levels"):
        artifacts.completed_at(tmp_path / "flow-0")


def test_json_nested_without_end_is_a_corrupt_manifest(stored):
    (stored / artifacts.MANIFEST).write_text("[" * 200_000)
    with pytest.raises(artifacts.CorruptArtifactError, match="not readable as JSON"):
        artifacts.read_manifest(stored)
