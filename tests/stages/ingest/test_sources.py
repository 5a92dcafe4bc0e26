from __future__ import annotations

import logging
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from schemas.config import IngestConfig
from schemas.errors import InputError
from stages.ingest.file_source import FileSource, file_source
from stages.ingest.sources import RoboartSource, list_sources
from stages.ingest.stage import compute_ingest

CONFIG = IngestConfig()


def write_frames(folder: Path, count: int = 3) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    for index in range(count):
        np.savetxt(folder / f"frame_{index}.xyz", rng.normal(size=(40, 3)))
    return folder


def write_truth(folder: Path, frames: int = 3) -> Path:
    np.savez(
        folder / "ground_truth.npz",
        labels=np.tile(np.arange(40) % 2, (frames, 1)),
        poses=np.tile(np.eye(4), (frames, 2, 1, 1)),
    )
    (folder / "ground_truth.json").write_text('{"root": 0, "edges_child_parent": [[1, 0]]}')
    return folder / "ground_truth.npz"


def write_pickles(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    cloud = np.random.default_rng(0).normal(size=(40, 3))
    for index in range(2):
        state = {"pc": cloud, "part_id": np.arange(40) % 2}
        (folder / f"state_{index}.pkl").write_bytes(pickle.dumps(state))
    (folder / "pose_1.pkl").write_bytes(pickle.dumps({0: np.eye(4), 1: np.eye(4)}))
    return folder


def names(data: Path) -> list[str]:
    return [source.name for source in list_sources(CONFIG, data)]


def refusal(config: IngestConfig, data: Path | None) -> str:
    with pytest.raises(InputError) as caught:
        list_sources(config, data)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_each_folder_and_each_array_with_frames_is_a_sequence(tmp_path: Path) -> None:
    write_frames(tmp_path / "robot_10")
    write_frames(tmp_path / "robot_9" / "frames")
    write_pickles(tmp_path / "original")
    np.save(tmp_path / "stack.npy", np.ones((2, 40, 3)))
    np.savez(tmp_path / "zipped.npz", points=np.ones((2, 40, 3)))
    np.savez(tmp_path / "ground_truth.npz", labels=np.zeros(3))
    write_frames(tmp_path / ".hidden")
    (tmp_path / "empty").mkdir()
    (tmp_path / "README.md").write_text("about")
    assert names(tmp_path) == ["original", "robot_9", "robot_10", "stack", "zipped"]
    assert [source.frames_path for source in list_sources(CONFIG, tmp_path)] == [
        *(tmp_path / name for name in ("original", "robot_9/frames", "robot_10", "stack.npy", "zipped.npz"))
    ]


def test_a_folder_that_is_one_sequence_is_one_in_every_layout(tmp_path: Path) -> None:
    write_frames(tmp_path / "direct")
    write_frames(tmp_path / "below" / "frames")
    np.save(tmp_path / "stack.npy", np.ones((2, 40, 3)))
    for data, name in (("direct", "direct"), ("below", "below"), ("below/frames", "below"), ("stack.npy", "stack")):
        assert names(tmp_path / data) == [name]
    for index in range(3):
        np.save(write_frames(tmp_path / "arrays", 0) / f"{index}.npy", np.ones((40, 3)))
    assert names(tmp_path / "arrays") == ["arrays"]


def test_the_ground_truth_is_found_beside_the_frames_or_above_them(tmp_path: Path) -> None:
    write_truth(write_frames(tmp_path / "direct"))
    write_frames(tmp_path / "below" / "frames")
    write_truth(tmp_path / "below")
    for path in ("direct", "below", "below/frames"):
        source = file_source(tmp_path / path)
        assert source.truth_path is not None
        loaded = compute_ingest(source, CONFIG, np.random.default_rng(0))
        assert loaded.truth is not None
        assert loaded.truth.parent.tolist() == [-1, 0]
        assert len(loaded.truth.labels) == 120
    pickles = file_source(write_pickles(tmp_path / "original"))
    truth = compute_ingest(pickles, CONFIG, np.random.default_rng(0)).truth
    assert truth is not None
    assert truth.parent.tolist() == [-1, -1]
    assert file_source(write_frames(tmp_path / "plain")).truth_path is None


def test_points_and_units_of_files_arrive_normalised(tmp_path: Path) -> None:
    source = file_source(write_frames(tmp_path / "a"))
    steps = []
    loaded = compute_ingest(
        source,
        IngestConfig(units="millimetre"),
        np.random.default_rng(0),
        lambda done, total, energy=None: steps.append((done, total)),
    )
    assert loaded.sequence.units == "millimetre"
    assert loaded.sequence.frame_names == ("frame_0.xyz", "frame_1.xyz", "frame_2.xyz")
    expected = np.loadtxt(tmp_path / "a" / "frame_1.xyz")
    np.testing.assert_allclose(loaded.sequence.to_input(loaded.sequence.frames()[1]), expected, atol=1e-12)
    assert steps == [(0, 1), (1, 1)]


def test_names_are_safe_parts_of_a_path(tmp_path: Path) -> None:
    for folder in ("my scan (1)", "a;b,c", "größe", "-rf"):
        write_frames(tmp_path / folder)
    found = names(tmp_path)
    assert sorted(found) == ["a_b_c", "größe", "my_scan_1", "rf"]
    assert file_source(Path("/")).name == "sequence"


def test_two_sequences_of_one_name_are_refused(tmp_path: Path) -> None:
    write_frames(tmp_path / "a b")
    write_frames(tmp_path / "a_b")
    message = refusal(CONFIG, tmp_path)
    assert "'a_b' twice" in message
    assert str(tmp_path / "a b") in message


def test_data_without_sequences_is_refused(tmp_path: Path) -> None:
    assert "no sequence" in refusal(CONFIG, tmp_path)
    assert "check the path" in refusal(CONFIG, tmp_path / "absent")
    assert "ingest.source" in refusal(CONFIG, None)


def test_a_file_that_is_no_sequence_is_reported_when_it_is_loaded(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 1 2 3")
    (source,) = list_sources(CONFIG, path)
    with pytest.raises(InputError, match=r"a\.obj"):
        source.load(CONFIG, np.random.default_rng(0))


def test_the_digest_changes_with_a_byte_a_name_or_the_truth_and_with_nothing_else(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "a")
    write_truth(folder)
    digests = [file_source(folder).digest()]
    assert digests[0] == file_source(folder).digest()
    (folder / "README").write_text("beside")
    (folder / ".DS_Store").write_text("beside")
    assert file_source(folder).digest() == digests[0]
    assert FileSource("b", write_frames(tmp_path / "b"), folder / "ground_truth.npz").digest() == digests[0]

    def changed() -> bool:
        digests.append(file_source(folder).digest())
        return digests.count(digests[-1]) == 1

    for name in ("frame_1.xyz", "ground_truth.npz", "ground_truth.json"):
        data = bytearray((folder / name).read_bytes())
        data[len(data) // 2] ^= 1
        (folder / name).write_bytes(data)
        assert changed()
    (folder / "frame_2.xyz").rename(folder / "frame_9.xyz")
    assert changed()
    first, second = (folder / f"frame_{index}.xyz" for index in (0, 1))
    contents = first.read_bytes(), second.read_bytes()
    first.write_bytes(contents[1])
    second.write_bytes(contents[0])
    assert changed()
    second.unlink()
    assert changed()
    (folder / "ground_truth.npz").unlink()
    assert changed()


def test_the_digest_of_pickles_covers_frames_and_transforms(tmp_path: Path) -> None:
    folder = write_pickles(tmp_path / "a")
    before = file_source(folder).digest()
    (folder / "graph.gpickle").write_bytes(b"ignored")
    assert file_source(folder).digest() == before
    (folder / "pose_1.pkl").write_bytes(b"other")
    assert file_source(folder).digest() != before


def test_the_digest_of_what_cannot_be_read_leaves_the_error_to_load(tmp_path: Path) -> None:
    source = file_source(tmp_path / "absent")
    assert len(source.digest()) == 64
    with pytest.raises(InputError, match="absent"):
        source.load(CONFIG, np.random.default_rng(0))


def test_listing_and_digests_need_neither_torch_nor_open3d(tmp_path: Path) -> None:
    write_frames(tmp_path / "a")
    program = (
        "import sys; from pathlib import Path; from schemas.config import IngestConfig; "
        "from stages.ingest.sources import list_sources; "
        f"[source.digest() for source in list_sources(IngestConfig(), Path({str(tmp_path)!r}))]; "
        "print([name for name in ('torch', 'open3d', 'scipy') if name in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


def test_roboart_gives_the_builders_robots() -> None:
    sources = list_sources(IngestConfig(source="roboart"), None)
    assert sources
    assert all(isinstance(source, RoboartSource) for source in sources)
    assert len({source.name for source in sources}) == len(sources)
    assert len(sources[0].digest()) == 64


def test_a_robot_arrives_normalised_in_metres_with_its_truth() -> None:
    config = IngestConfig(source="roboart", roboart={"frames": 3, "points": 200, "novel_states": 1})
    source = next(source for source in list_sources(config, None) if source.name == "bolt")
    loaded = source.load(config, np.random.default_rng(0))
    assert loaded.sequence.units == "metre"
    assert loaded.sequence.point_counts.tolist() == [200, 200, 200]
    assert loaded.truth is not None
    assert loaded.truth.joints
    assert loaded.truth.Ts_novel_first.shape[0] == 1


def test_every_second_frame_is_the_sequence_of_those_frames_with_their_truth() -> None:
    source = RoboartSource("bolt", "bolt", 0)
    config = IngestConfig(source="roboart", units="metre", roboart={"points": 300, "frames": 5})
    whole, half = (
        source.load(config.model_copy(update={"every": every}), np.random.default_rng(0)) for every in (1, 2)
    )
    assert half.sequence.frame_names == whole.sequence.frame_names[::2]
    for here, there in zip(half.sequence.frames(), whole.sequence.frames()[::2], strict=True):
        np.testing.assert_allclose(half.sequence.to_input(here), whole.sequence.to_input(there))
    assert half.truth is not None
    assert whole.truth is not None
    np.testing.assert_array_equal(half.true_labels(1), whole.true_labels(2))
    assert [joint.states for joint in half.truth.joints] == [joint.states[::2] for joint in whole.truth.joints]
    with pytest.raises(InputError, match=r"ingest\.every: found 5, which leaves one frame of 5, expected two; .* 4"):
        source.load(config.model_copy(update={"every": 5}), np.random.default_rng(0))


LID = """<robot name="box"><link name="box"><visual><geometry><box size="1 1 0.5"/></geometry></visual></link>
<link name="lid"><visual><geometry><box size="1 1 0.1"/></geometry></visual></link>
<joint name="hinge" type="revolute"><parent link="box"/><child link="lid"/><origin xyz="0 0 0.4"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1.5" effort="1" velocity="1"/></joint></robot>"""


def test_urdf_gives_everything_described_in_a_folder_moving_in_as_many_ways_as_asked(tmp_path: Path) -> None:
    (tmp_path / "a box").mkdir()
    (tmp_path / "a box" / "mobility.urdf").write_text(LID)
    config = IngestConfig(
        source="urdf", roboart={"frames": 3, "points": 200, "novel_states": 1, "sequences_per_robot": 2}
    )
    sources = list_sources(config, tmp_path)
    assert [source.name for source in sources] == ["a_box-0", "a_box-1"]
    assert len({source.digest() for source in sources}) == 2
    first, second = (source.load(config, np.random.default_rng(0)).truth for source in sources)
    assert first is not None
    assert second is not None
    assert first.part_names == ("box", "lid")
    assert first.joints[0].states != second.joints[0].states


def test_urdf_refuses_two_things_of_one_name(tmp_path: Path) -> None:
    for name in ("a box.urdf", "a_box.urdf"):
        (tmp_path / name).write_text(LID)
    with pytest.raises(InputError, match=r"a_box\.urdf: found the sequence name 'a_box' twice"):
        list_sources(IngestConfig(source="urdf"), tmp_path)
    (tmp_path / "a box.urdf").unlink()
    (tmp_path / "a_box").mkdir()
    (tmp_path / "a_box" / "a_box.urdf").write_text(LID)
    with pytest.raises(InputError, match=r"found the sequence name 'a_box' twice"):
        list_sources(IngestConfig(source="urdf"), tmp_path)


def test_urdf_refuses_a_folder_that_is_not_given_or_holds_no_description(tmp_path: Path) -> None:
    config = IngestConfig(source="urdf")
    for data, message in (
        (None, "found 'urdf' without a folder of URDF files"),
        (tmp_path / "nowhere", "expected URDF files"),
        (tmp_path, "found no URDF"),
    ):
        with pytest.raises(InputError, match=message):
            list_sources(config, data)


def test_tables_make_sequences_and_one_alone_does_not(tmp_path: Path) -> None:
    for index in range(2):
        (tmp_path / "scan").mkdir(exist_ok=True)
        np.savetxt(tmp_path / "scan" / f"{index}.csv", np.ones((40, 3)), delimiter=",")
    write_frames(tmp_path / "other")
    np.savetxt(tmp_path / "grasp.csv", np.ones((4, 6)), delimiter=",")
    assert names(tmp_path) == ["other", "scan"]
    assert names(tmp_path / "scan") == ["scan"]
    for folder in ("alone", "nested"):
        (tmp_path / folder).mkdir()
    np.savetxt(tmp_path / "alone" / "log.csv", np.ones((40, 3)), delimiter=",")
    np.savez(tmp_path / "nested" / "stack.npz", points=np.ones((2, 40, 3)))
    assert names(tmp_path) == ["other", "scan"]


def test_data_with_a_folder_for_each_frame_is_refused(tmp_path: Path) -> None:
    for name in ("scan1", "scan2"):
        write_frames(tmp_path / name, 1)
    assert "a folder for each frame (scan1/frame_0.xyz, scan2/frame_0.xyz, ...)" in refusal(CONFIG, tmp_path)
    write_frames(tmp_path / "whole")
    assert names(tmp_path) == ["scan1", "scan2", "whole"]


def test_many_frames_bring_a_hint_at_every(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    np.save(tmp_path / "video.npy", np.random.default_rng(0).normal(size=(300, 40, 3)))
    source = file_source(tmp_path / "video.npy")
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        source.load(IngestConfig(every=6), np.random.default_rng(0))
        assert not caplog.records
        source.load(CONFIG, np.random.default_rng(0))
    assert "300 frames" in caplog.text
    assert "--set ingest.every=6" in caplog.text


def test_the_settings_limit_holds_for_a_source(tmp_path: Path) -> None:
    source = file_source(write_frames(tmp_path / "a"))
    assert source.load(IngestConfig(max_points=120), np.random.default_rng(0)).sequence.frame_count == 3
    with pytest.raises(InputError, match=r"frame_2\.xyz: found 40 points and 80 in .* at most 119 "):
        source.load(IngestConfig(max_points=119), np.random.default_rng(0))


@pytest.mark.parametrize("name", ["frame_1.xyz", "ground_truth.npz", "ground_truth.json"])
def test_an_unreadable_file_is_named_by_digest_and_load(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    folder = write_frames(tmp_path / "a")
    write_truth(folder)
    source, opened = file_source(folder), Path.open

    def refused(self: Path, *arguments: object, **options: object) -> object:
        if self.name == name:
            raise PermissionError(13, "Permission denied", str(self))
        return opened(self, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "open", refused)
    for read in (source.digest, lambda: source.load(CONFIG, np.random.default_rng(0))):
        with pytest.raises(InputError) as caught:
            read()
        assert str(caught.value).startswith(f"{folder / name}: cannot be read (Permission denied)")


def refuse_listing(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    listed = Path.iterdir

    def refused(self: Path) -> object:
        if self.name == name:
            raise PermissionError(13, "Permission denied", str(self))
        return listed(self)

    monkeypatch.setattr(Path, "iterdir", refused)


def test_a_folder_that_cannot_be_listed_fails_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "b"):
        write_frames(tmp_path / name)
    (tmp_path / "lost+found").mkdir()
    refuse_listing(monkeypatch, "lost+found")
    assert names(tmp_path) == ["a", "b", "lost_found"]
    with pytest.raises(InputError, match=r"lost\+found: the folder cannot be listed \(Permission denied\)"):
        list_sources(CONFIG, tmp_path)[2].digest()


def test_tables_beside_a_folder_that_cannot_be_listed_stay_one_sequence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for index in range(2):
        np.savetxt(tmp_path / f"{index}.csv", np.ones((40, 3)), delimiter=",")
    (tmp_path / "lost+found").mkdir()
    refuse_listing(monkeypatch, "lost+found")
    assert [source.frames_path for source in list_sources(CONFIG, tmp_path)] == [tmp_path]


def test_a_folder_of_descriptions_that_cannot_be_listed_fails_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mobility.urdf").write_text(LID)
    refuse_listing(monkeypatch, "b")
    first, second = list_sources(IngestConfig(source="urdf"), tmp_path)
    assert (first.name, second.name) == ("a", "b")
    assert len(first.digest()) == 64
    with pytest.raises(InputError, match="b: cannot be read"):
        second.digest()


@pytest.mark.parametrize("kept", [3000, 40, 0])
def test_a_damaged_stack_fails_alone(tmp_path: Path, kept: int) -> None:
    for name in ("x", "y"):
        np.save(tmp_path / f"{name}.npy", np.ones((2, 400, 3)))
        np.savez(tmp_path / f"{name}z.npz", points=np.ones((2, 400, 3)))
    for name in ("x", "y"):
        path = tmp_path / f"{name}.npy"
        path.write_bytes(path.read_bytes()[:kept])
        assert names(tmp_path) == ["x", "xz", "y", "yz"]
    with pytest.raises(InputError, match=r"x\.npy: cannot be read as \.npy"):
        list_sources(CONFIG, tmp_path)[0].load(CONFIG, np.random.default_rng(0))


def test_a_damaged_frame_among_npy_frames_leaves_them_one_sequence(tmp_path: Path) -> None:
    for index in range(2):
        np.save(tmp_path / f"{index}.npy", np.ones((400, 3)))
    for index in range(2):
        (tmp_path / f"{index}.npy").write_bytes(b"text")
        assert [source.frames_path for source in list_sources(CONFIG, tmp_path)] == [tmp_path]


def test_an_unreadable_table_beside_sequences_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_frames(tmp_path / "a")
    (tmp_path / "notes.txt").write_text("about")
    opened = Path.open

    def refused(self: Path, *arguments: object, **options: object) -> object:
        if self.name == "notes.txt":
            raise PermissionError(13, "Permission denied", str(self))
        return opened(self, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "open", refused)
    assert names(tmp_path) == ["a"]


def test_models_in_a_data_set_are_no_sequences(tmp_path: Path) -> None:
    np.save(tmp_path / "stack.npy", np.ones((2, 40, 3)))
    (tmp_path / "out").mkdir()
    for folder in (tmp_path, tmp_path / "out"):
        np.savez(folder / "model.npz", points=np.ones((80, 3)), poses=np.ones((2, 1, 4, 4)))
        (folder / "model.json").write_text("{}")
    assert names(tmp_path) == ["stack"]


def test_a_folder_of_links_to_nothing_is_a_sequence_that_fails(tmp_path: Path) -> None:
    write_frames(tmp_path / "a")
    (tmp_path / "b").mkdir()
    for index in range(2):
        (tmp_path / "b" / f"{index}.ply").symlink_to(tmp_path / "unfetched")
    (tmp_path / "c.npy").symlink_to(tmp_path / "unfetched")
    os.mkfifo(tmp_path / "d.npy")
    assert names(tmp_path) == ["a", "b", "c"]
    with pytest.raises(InputError, match=r"0\.ply \(a link to nothing\)"):
        list_sources(CONFIG, tmp_path)[1].load(CONFIG, np.random.default_rng(0))


def test_folders_of_a_cloud_and_its_colours_are_no_sequences(tmp_path: Path) -> None:
    for name in ("scan1", "scan2"):
        (tmp_path / name).mkdir()
        for file in ("cloud", "color"):
            np.save(tmp_path / name / f"{file}.npy", np.ones((40, 3)))
    assert "a folder for each frame (scan1/cloud.npy, scan2/cloud.npy, ...)" in refusal(CONFIG, tmp_path)


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("kind", ["folder", "npy", "npz", "npz of frames"])
def test_the_count_of_frames_is_known_before_they_are_read(tmp_path, kind, every):
    frames = np.random.default_rng(0).uniform(size=(5, 40, 3))
    path = tmp_path / f"lamp.{kind[:3]}" if kind != "folder" else tmp_path
    if kind == "folder":
        for number, frame in enumerate(frames):
            np.save(tmp_path / f"{number}.npy", frame)
    elif kind == "npy":
        np.save(path, frames)
    elif kind == "npz":
        np.savez(path, points=frames)
    else:
        np.savez(path, *frames)
    source, config = file_source(path), IngestConfig(every=every)
    assert source.frame_count(config) == source.load(config, np.random.default_rng(0)).sequence.frame_count


def test_a_damaged_file_has_no_count_of_frames(tmp_path):
    (tmp_path / "lamp.npy").write_bytes(b"\x93NUMPY damaged")
    assert file_source(tmp_path / "lamp.npy").frame_count(IngestConfig()) is None
