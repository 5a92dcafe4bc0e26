from __future__ import annotations

import gzip
import logging
import os
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from schemas.errors import InputError
from stages.ingest.point_formats import FRAME_SUFFIXES
from stages.ingest.readers import read_frames

RNG = np.random.default_rng(0)


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_frames(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


def write_xyz(path: Path, points: np.ndarray) -> None:
    np.savetxt(path, points)


def write_ply(path: Path, points: np.ndarray) -> None:
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property double {name}\n" for name in "xyz") + "end_header\n"
    path.write_bytes(header.encode() + points.astype("<f8").tobytes())


def write_pcd(path: Path, points: np.ndarray) -> None:
    header = "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH {0}\nHEIGHT 1\nPOINTS {0}\nDATA binary\n"
    path.write_bytes(header.format(len(points)).encode() + points.astype("<f8").tobytes())


def write_state(path: Path, points: np.ndarray) -> None:
    path.write_bytes(pickle.dumps({"pc": points, "part_id": np.zeros(len(points), dtype=np.int64)}))


WRITERS = {".xyz": write_xyz, ".ply": write_ply, ".pcd": write_pcd, ".npy": np.save}


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_folder_of_each_format_gives_its_frames_of_any_length(tmp_path: Path, suffix: str) -> None:
    clouds = [RNG.normal(size=(count, 3)) for count in (40, 33, 57)]
    for index, cloud in enumerate(clouds):
        WRITERS[suffix](tmp_path / f"frame_{index}{suffix}", cloud)
    frames = read_frames(tmp_path)
    assert [frame.name for frame in frames] == [f"frame_{index}{suffix}" for index in range(3)]
    for frame, cloud in zip(frames, clouds, strict=True):
        np.testing.assert_allclose(frame.points, cloud, rtol=1e-15)
        assert frame.points.dtype == np.float64


def test_frames_come_in_natural_order(tmp_path: Path) -> None:
    for name in ("frame_10", "frame_2", "frame_1", "a_100", "a_20", "frame_002b"):
        write_xyz(tmp_path / f"{name}.xyz", np.full((2, 3), 1.0))
    names = [frame.name.removesuffix(".xyz") for frame in read_frames(tmp_path)]
    assert names == ["a_20", "a_100", "frame_1", "frame_2", "frame_002b", "frame_10"]


def test_endings_may_be_in_capitals_and_other_files_may_lie_beside(tmp_path: Path) -> None:
    for index in range(2):
        write_ply(tmp_path / f"{index}.PLY", np.ones((3, 3)))
    for name in ("README.md", ".DS_Store", "._0.ply", "ground_truth.npz", "pose_1.pkl", "ground_truth.json"):
        (tmp_path / name).write_text("something else")
    (tmp_path / "folder.ply").mkdir()
    assert [frame.name for frame in read_frames(tmp_path)] == ["0.PLY", "1.PLY"]


def test_the_original_roboarts_states_are_frames(tmp_path: Path) -> None:
    clouds = RNG.normal(size=(11, 20, 3))
    for index, cloud in enumerate(clouds):
        write_state(tmp_path / f"state_{index}.pkl", cloud)
    (tmp_path / "graph.gpickle").write_bytes(b"cos\nsystem\n(Vfalse\ntR.")
    (tmp_path / "part_mapping.pkl").write_bytes(b"cos\nsystem\n(Vfalse\ntR.")
    np.testing.assert_array_equal([frame.points for frame in read_frames(tmp_path)], clouds)


def test_one_array_of_all_frames_is_read_from_npy_and_npz(tmp_path: Path) -> None:
    stack = RNG.normal(size=(4, 30, 3)).astype(np.float32)
    np.save(tmp_path / "a.npy", stack)
    np.savez(tmp_path / "b.npz", anything=stack)
    np.savez_compressed(tmp_path / "c.npz", points=stack, labels=np.zeros((4, 30)))
    np.savez(tmp_path / "d.npz", pc=(stack * 1000).astype(np.int32), labels=np.zeros((4, 30)))
    for name, expected in (("a.npy", stack), ("b.npz", stack), ("c.npz", stack), ("d.npz", np.trunc(stack * 1000))):
        frames = read_frames(tmp_path / name)
        np.testing.assert_array_equal([frame.points for frame in frames], expected)
        assert [frame.name for frame in frames] == [f"{name}[{index}]" for index in range(4)]


def test_nan_points_are_kept_for_the_next_step_to_count(tmp_path: Path) -> None:
    stack = RNG.normal(size=(2, 30, 3))
    stack[1, 3, 2] = np.nan
    np.save(tmp_path / "a.npy", stack)
    np.testing.assert_array_equal(read_frames(tmp_path / "a.npy")[1].points, stack[1])


def test_a_path_that_does_not_exist_is_named(tmp_path: Path) -> None:
    assert "neither a file nor a folder" in refusal(tmp_path / "absent")


def test_an_empty_folder_is_named(tmp_path: Path) -> None:
    assert "an empty folder" in refusal(tmp_path)


def test_a_folder_without_frames_names_what_lies_there(tmp_path: Path) -> None:
    for name in ("a.fbx", "b.fbx", "c.txt", "d.step"):
        (tmp_path / name).write_text("about these scans\n")
    assert "no frame among a.fbx, b.fbx, c.txt, ..." in refusal(tmp_path)


def test_frames_of_two_kinds_in_one_folder_are_refused(tmp_path: Path) -> None:
    write_xyz(tmp_path / "0.xyz", np.ones((2, 3)))
    write_ply(tmp_path / "1.ply", np.ones((2, 3)))
    assert ".ply and .xyz" in refusal(tmp_path)


def test_one_frame_only_is_refused_in_each_form(tmp_path: Path) -> None:
    np.save(tmp_path / "one.npy", np.ones((1, 40, 3)))
    assert "found 1 frame, expected at least 2" in refusal(tmp_path / "one.npy")
    np.save(tmp_path / "flat.npy", np.ones((40, 3)))
    assert "expected (frames, points, 3)" in refusal(tmp_path / "flat.npy")
    folder = tmp_path / "folder"
    folder.mkdir()
    write_ply(folder / "0.ply", np.ones((40, 3)))
    assert "found 1 frame" in refusal(folder)
    assert "give the folder" in refusal(folder / "0.ply")


def test_a_file_with_a_wrong_ending_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.fbx").write_text("v 1 2 3\n")
    assert "found a .fbx file" in refusal(tmp_path / "a.fbx")
    (tmp_path / "noending").write_text("1 2 3\n")
    refusal(tmp_path / "noending")


def test_the_damaged_frame_of_a_folder_is_named(tmp_path: Path) -> None:
    for index in range(3):
        write_ply(tmp_path / f"{index}.ply", np.ones((40, 3)))
    broken = tmp_path / "1.ply"
    broken.write_bytes(broken.read_bytes()[:-10])
    assert str(broken) in refusal(tmp_path)
    write_ply(broken, np.ones((40, 3)))
    read_frames(tmp_path)


@pytest.mark.parametrize(
    "stack",
    [
        np.ones((3, 40, 2)),
        np.ones(40),
        np.ones((3, 2, 40, 3)),
        np.ones((3, 40, 3), dtype=complex),
        np.ones((3, 40, 3), dtype=bool),
        np.full((3, 40, 3), None),
        np.full((3, 40, 3), "1"),
    ],
    ids=lambda stack: f"{stack.dtype}{stack.shape}",
)
def test_arrays_of_other_shapes_and_types_are_refused(tmp_path: Path, stack: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", stack)
    refusal(tmp_path / "a.npy")
    np.savez(tmp_path / "a.npz", points=stack)
    refusal(tmp_path / "a.npz")


def test_frames_in_two_dimensions_are_refused_with_their_shape(tmp_path: Path) -> None:
    for index in range(2):
        np.save(tmp_path / f"{index}.npy", np.ones((40, 2)))
    assert "(40, 2)" in refusal(tmp_path)


def test_an_npz_must_say_which_array_holds_the_points(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", first=np.ones((2, 40, 3)), second=np.ones((2, 40, 3)))
    assert "first (2, 40, 3), second (2, 40, 3)" in refusal(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz")
    refusal(tmp_path / "a.npz")


def test_a_damaged_npz_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, points=RNG.normal(size=(3, 40, 3)))
    whole = path.read_bytes()
    middle = len(whole) // 2
    for data in (b"", b"text", whole[:middle], whole[:middle] + bytes(20) + whole[middle + 20 :]):
        path.write_bytes(data)
        assert "unsafely" not in refusal(path)  # numpy's own message advises to unpickle
    np.save(tmp_path / "b.npy", np.ones((2, 40, 3)))
    (tmp_path / "b.npy").rename(tmp_path / "b.npz")
    refusal(tmp_path / "b.npz")


def test_a_state_that_holds_something_else_is_refused(tmp_path: Path) -> None:
    write_state(tmp_path / "state_0.pkl", np.ones((40, 3)))
    for content in ({"points": np.ones((40, 3))}, [1, 2], {"pc": [[1, 2, 3]]}, {"pc": np.ones((40, 2))}):
        (tmp_path / "state_1.pkl").write_bytes(pickle.dumps(content))
        assert "state_1.pkl" in refusal(tmp_path)


def test_frames_come_in_the_order_of_their_times(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name in ("1.2", "0.9", "1.05", "-0.5"):
        write_xyz(tmp_path / f"{name}.xyz", np.ones((2, 3)))
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        names = [frame.name.removesuffix(".xyz") for frame in read_frames(tmp_path)]
    assert names == ["-0.5", "0.9", "1.05", "1.2"]
    assert not caplog.records
    write_xyz(tmp_path / "last.xyz", np.ones((2, 3)))
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        read_frames(tmp_path)
    assert "in this order: -0.5.xyz, 0.9.xyz, 1.05.xyz, 1.2.xyz, last.xyz" in caplog.text


def test_a_folder_for_each_frame_and_folders_of_sequences_are_told(tmp_path: Path) -> None:
    for name in ("scan1", "scan2", "scan10"):
        (tmp_path / name).mkdir()
        write_ply(tmp_path / name / "cloud.ply", np.ones((40, 3)))
    message = refusal(tmp_path)
    assert "a folder for each frame (scan1/cloud.ply, scan2/cloud.ply, ...)" in message
    assert "(scan1.ply, scan2.ply, ...)" in message
    write_ply(tmp_path / "scan1" / "cloud2.ply", np.ones((40, 3)))
    assert "folders with frames (scan1)" in refusal(tmp_path)


def test_tables_are_frames_where_no_other_files_are(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for index in range(2):
        write_xyz(tmp_path / f"{index}.txt", np.ones((40, 3)))
    (tmp_path / "readme.txt").write_text("about these scans\n")
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        assert [frame.name for frame in read_frames(tmp_path)] == ["0.txt", "1.txt"]
    assert "readme.txt" in caplog.text
    for index in range(2):
        write_ply(tmp_path / f"{index}.ply", np.ones((40, 3)))
    assert [frame.name for frame in read_frames(tmp_path)] == ["0.ply", "1.ply"]


def test_columns_beyond_the_third_of_npy_frames_are_left_out(tmp_path: Path) -> None:
    clouds = RNG.normal(size=(2, 40, 6))
    for index, cloud in enumerate(clouds):
        np.save(tmp_path / f"{index}.npy", cloud)
    np.testing.assert_array_equal([frame.points for frame in read_frames(tmp_path)], clouds[:, :, :3])


def test_points_are_counted_over_the_frames_that_are_used(tmp_path: Path) -> None:
    for index in range(4):
        write_ply(tmp_path / f"{index}.ply", np.ones((40, 3)))
    assert len(read_frames(tmp_path, max_points=160)) == 4
    assert len(read_frames(tmp_path, every=2, max_points=80)) == 2
    with pytest.raises(InputError) as caught:
        read_frames(tmp_path, max_points=100)
    assert str(caught.value).startswith(f"{tmp_path / '2.ply'}: found 40 points and 80 in the frames before, ")
    assert "expected at most 100 in all frames (ingest.max_points)" in str(caught.value)


def test_only_the_frames_that_are_used_are_read(tmp_path: Path) -> None:
    for index in range(4):
        write_ply(tmp_path / f"{index}.ply", np.ones((40, 3)))
    (tmp_path / "1.ply").write_text("damaged")
    assert [frame.name for frame in read_frames(tmp_path, every=2)] == ["0.ply", "2.ply"]


def test_a_folder_that_may_not_be_looked_into_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_ply(tmp_path / "0.ply", np.ones((40, 3)))

    def refused(self: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(self))

    for method in ("is_file", "iterdir", "is_dir"):
        with monkeypatch.context() as patch:
            patch.setattr(Path, method, refused)
            assert "Permission denied" in refusal(tmp_path)


def test_a_damaged_npy_header_ends_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.ones((2, 40, 3)))
    whole = path.read_bytes()
    for old, new in ((b"}", b" "), (b"(2, 40, 3)", b"(2,-40, 3)"), (b"(2, 40, 3)", b"(2, 40, (((")):
        path.write_bytes(whole.replace(old, new, 1))
        refusal(path)
        path.write_bytes(whole)
        np.savez(tmp_path / "a.npz", points=np.ones((2, 40, 3)))
        data = (tmp_path / "a.npz").read_bytes()
        (tmp_path / "a.npz").write_bytes(data.replace(old, new, 1))
        refusal(tmp_path / "a.npz")


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".ply"])
def test_a_model_and_a_pose_beside_the_frames_are_no_frames(tmp_path: Path, suffix: str) -> None:
    for index in range(2):
        match suffix:
            case ".npz":
                np.savez(tmp_path / f"f{index}.npz", points=np.ones((40, 3)))
            case ".csv":
                np.savetxt(tmp_path / f"f{index}.csv", np.ones((40, 3)), delimiter=",")
            case _:
                write_ply(tmp_path / f"f{index}.ply", np.ones((40, 3)))
    np.savez(tmp_path / "model.npz", points=np.ones((40, 3)), labels=np.zeros(40))
    write_ply(tmp_path / "posed.ply", np.ones((40, 3)))
    for name in ("model.json", "pose.json"):
        (tmp_path / name).write_text("{}")
    assert [frame.name for frame in read_frames(tmp_path)] == [f"f0{suffix}", f"f1{suffix}"]


def test_what_looks_like_a_frame_but_is_left_out_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for index in range(2):
        write_ply(tmp_path / f"{index}.ply", np.ones((40, 3)))
    write_ply(tmp_path / ".5.ply", np.ones((40, 3)))
    (tmp_path / "2.ply").symlink_to(tmp_path / "unfetched")
    (tmp_path / "3.ply").symlink_to(tmp_path / "3.ply")
    os.mkfifo(tmp_path / "4.ply")
    (tmp_path / "._0.ply").write_text("macOS")
    (tmp_path / "folder.ply").mkdir()
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        assert [frame.name for frame in read_frames(tmp_path)] == ["0.ply", "1.ply"]
    assert "left out 2.ply (a link to nothing), 3.ply (a link to nothing), 4.ply (no plain file), ..." in caplog.text
    for name in ("0.ply", "1.ply", "2.ply", "3.ply"):
        (tmp_path / name).unlink()
    assert "found no frames but 4.ply (no plain file), .5.ply (hidden), expected a folder" in refusal(tmp_path)


@pytest.mark.parametrize("shape", [(6, 8), (1, 48), (6, 8, 6)], ids=str)
def test_npy_frames_of_rows_and_columns_are_flattened(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, shape: tuple[int, ...]
) -> None:
    clouds = RNG.normal(size=(3, *shape[:2], *(shape[2:] or (3,))))
    for index, cloud in enumerate(clouds):
        np.save(tmp_path / f"{index}.npy", cloud)
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        frames = read_frames(tmp_path)
    np.testing.assert_array_equal([frame.points for frame in frames], clouds.reshape(3, 48, -1)[..., :3])
    assert "the rows and columns of one frame" in caplog.text
    with pytest.raises(InputError, match="found 48 points and 96 in the frames before, expected at most 100"):
        read_frames(tmp_path, max_points=100)


def test_advice_is_given_once(tmp_path: Path) -> None:
    np.save(tmp_path / "0.npy", np.ones((40, 3)))
    np.save(tmp_path / "1.npy", np.ones((6, 8, 3)))
    assert refusal(tmp_path).endswith("(6, 8, 3) among frames; give that file itself as the sequence")


LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 123\n"
DISGUISES = {"git lfs pull": LFS, "gunzip": gzip.compress(b"1 2 3\n" * 40), "HTML": b"<!DOCTYPE html>\n<p>404\n"}


@pytest.mark.parametrize("suffix", FRAME_SUFFIXES)
@pytest.mark.parametrize("found", DISGUISES)
def test_another_kind_of_file_is_named(tmp_path: Path, suffix: str, found: str) -> None:
    for index in range(2):
        (tmp_path / f"{index}{suffix}").write_bytes(DISGUISES[found])
    assert found in refusal(tmp_path)
    if suffix in (".npy", ".npz"):
        assert found in refusal(tmp_path / f"0{suffix}")


def test_a_folder_for_each_frame_may_hold_its_colours_too(tmp_path: Path) -> None:
    for name in ("scan1", "scan2"):
        (tmp_path / name).mkdir()
        for file in ("cloud", "color"):
            np.save(tmp_path / name / f"{file}.npy", np.ones((40, 3)))
    assert "a folder for each frame (scan1/cloud.npy, scan2/cloud.npy, ...)" in refusal(tmp_path)
    for name in ("scan1", "scan2"):
        (tmp_path / name / "color.npy").rename(tmp_path / name / "cloud2.npy")
    assert "folders with frames (scan1, scan2)" in refusal(tmp_path)


@pytest.mark.parametrize("write", [write_ply, write_pcd])
def test_lines_that_end_with_cr_are_named(tmp_path: Path, write: Callable[[Path, np.ndarray], None]) -> None:
    suffix = f".{write.__name__.removeprefix('write_')}"
    for index in range(2):
        path = tmp_path / f"{index}{suffix}"
        write(path, np.ones((40, 3)))
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r"))
    assert "lines that end with CR alone" in refusal(tmp_path)


@pytest.mark.parametrize("length", [np.nan, np.inf, -1.0, 0.5])
def test_lists_of_odd_lengths_are_refused(tmp_path: Path, length: float) -> None:
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty list float int ids\n"
    header += "".join(f"property float {name}\n" for name in "xyz") + "end_header\n"
    for index in range(2):
        (tmp_path / f"{index}.ply").write_bytes(header.encode() + np.array([length, 1, 2, 3] * 2, "<f4").tobytes())
    assert f"found a list of {length} values" in refusal(tmp_path)


def test_no_frame_at_all_is_said_so(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.ones((0, 40, 3)))
    assert "found no frame, expected at least 2" in refusal(tmp_path / "a.npy")


@pytest.mark.parametrize("stacks", [{"lamp": (5, 40, 3), "door": (5, 40, 3)}, {"0": (5, 40, 3), "1": (6, 40, 3)}])
def test_a_folder_of_whole_sequences_is_no_sequence(tmp_path: Path, stacks: dict[str, tuple[int, ...]]) -> None:
    for name, shape in stacks.items():
        np.save(tmp_path / f"{name}.npy", np.ones(shape))
    assert "give that file itself as the sequence" in refusal(tmp_path)
