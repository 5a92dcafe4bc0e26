from __future__ import annotations

import io
import logging
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from schemas.errors import InputError
from stages.ingest.formats.arrays import load_npz
from stages.ingest.readers import read_frames

RNG = np.random.default_rng(0)
CLOUDS = [RNG.normal(size=(count, 3)) for count in (40, 50, 45)]
STACK = RNG.normal(size=(4, 40, 3))


def saved(folder: Path, *arrays: np.ndarray, **named: object) -> Path:
    np.savez(folder / "a.npz", *arrays, **named)  # type: ignore[arg-type]
    return folder / "a.npz"


def names(path: Path) -> list[str]:
    return [frame.name.removeprefix(f"{path.name}[").removesuffix("]") for frame in read_frames(path)]


def refusal(path: Path, **limits: int) -> str:
    with pytest.raises(InputError) as caught:
        read_frames(path, **limits)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def objects(values: list[object]) -> np.ndarray:
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array


def npy(shape: tuple[int, ...], data: bytes = b"") -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return file.getvalue() + data


def zipped(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name.replace("_npy", ".npy").replace("_txt", ".txt"), data)
    return path


def test_frames_of_different_lengths_are_read_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    frames = read_frames(saved(tmp_path, *CLOUDS))
    for frame, cloud in zip(frames, CLOUDS, strict=True):
        np.testing.assert_array_equal(frame.points, cloud)
    many = [RNG.normal(size=(40, 3)) for _ in range(12)]
    assert names(saved(tmp_path, *many)) == [f"arr_{index}" for index in range(12)]
    by_name = {f"frame_{index}": cloud for index, cloud in enumerate(CLOUDS)}
    path = saved(tmp_path, **by_name, T0=np.eye(4), labels=np.zeros(40))
    assert names(path) == ["frame_0", "frame_1", "frame_2"]


@pytest.mark.parametrize("ends", [("pc_start", "pc_end"), ("before", "after"), ("source_points", "target_points")])
def test_a_start_and_an_end_are_two_frames(tmp_path: Path, ends: tuple[str, str]) -> None:
    path = saved(tmp_path, **{ends[1]: CLOUDS[1], ends[0]: CLOUDS[0]}, pc_seg_start=np.zeros(40), screw_axis=np.ones(3))
    assert names(path) == list(ends)


def test_what_is_not_needed_is_neither_unpickled_nor_a_reason_to_refuse(tmp_path: Path) -> None:
    pickled = objects([{"a": 1}, {"b": 2}])
    path = saved(tmp_path, pc=STACK, segm=np.zeros((4, 40), dtype=int), trans=pickled, name=np.array("chair"))
    np.testing.assert_array_equal([frame.points for frame in read_frames(path)], STACK)
    assert names(saved(tmp_path, *CLOUDS, meta=pickled)) == ["arr_0", "arr_1", "arr_2"]
    stack = npy(STACK.shape, STACK.astype("<f4").tobytes())
    path = zipped(tmp_path / "b.npz", points_npy=stack, readme_txt=b"hello", bad_npy=b"no array")
    assert len(read_frames(path)) == 4


def test_the_one_array_that_can_be_frames_is_taken_and_points_before_colours(tmp_path: Path) -> None:
    assert len(read_frames(saved(tmp_path, anything=STACK, times=np.arange(4)))) == 4
    path = saved(tmp_path, flow=STACK * 0, PC=STACK)
    np.testing.assert_array_equal(read_frames(path)[1].points, STACK[1])
    path = saved(tmp_path, rgb_0=CLOUDS[0], xyz_0=CLOUDS[0], rgb_1=CLOUDS[1], xyz_1=CLOUDS[1])
    assert names(path) == ["xyz_0", "xyz_1"]


def test_object_arrays_lead_to_one_file_a_frame(tmp_path: Path) -> None:
    assert "one .npy for each frame in a folder" in refusal(saved(tmp_path, frames=objects(CLOUDS)))
    np.save(tmp_path / "a.npy", objects(CLOUDS), allow_pickle=True)
    message = refusal(tmp_path / "a.npy")
    assert "never unpickled; save one .npy for each frame in a folder" in message


@pytest.mark.parametrize("columns", [4, 6, 9])
@pytest.mark.parametrize("order", ["C", "F"])
def test_colours_and_normals_beside_the_coordinates_are_left_out(tmp_path: Path, columns: int, order: str) -> None:
    stack = np.asarray(np.concatenate([STACK, RNG.normal(size=(4, 40, columns - 3))], axis=2), order=order)  # type: ignore[call-overload]
    np.save(tmp_path / "a.npy", stack)
    for path in (tmp_path / "a.npy", saved(tmp_path, points=stack)):
        np.testing.assert_array_equal([frame.points for frame in read_frames(path)], STACK)
        np.testing.assert_array_equal([frame.points for frame in read_frames(path, every=3)], STACK[::3])


def test_fields_x_y_z_of_a_structured_array_are_coordinates(tmp_path: Path) -> None:
    table = np.zeros((4, 40), dtype=[("rgb", "u4"), ("z", "f8"), ("y", "f8"), ("x", "f8")])
    table["x"], table["y"], table["z"] = np.moveaxis(STACK, 2, 0)
    np.save(tmp_path / "a.npy", table)
    for index in range(2):
        np.save(tmp_path / "a.npy", table)
        (tmp_path / "folder").mkdir(exist_ok=True)
        np.save(tmp_path / "folder" / f"{index}.npy", table[index])
    for path in (tmp_path / "a.npy", saved(tmp_path, points=table), tmp_path / "folder"):
        np.testing.assert_array_equal(read_frames(path)[1].points, STACK[1])


def test_axes_in_another_order_and_images_are_told(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((4, 3, 400)))
    assert "array.transpose(0, 2, 1)" in refusal(tmp_path / "a.npy")
    assert "array.transpose(0, 2, 1)" in refusal(saved(tmp_path, points=np.zeros((4, 3, 400))))
    assert "(4, 48, 64)" in refusal(saved(tmp_path, depth=np.zeros((4, 48, 64))))
    (tmp_path / "folder").mkdir()
    for index in range(2):
        np.save(tmp_path / "folder" / f"{index}.npy", np.zeros((3, 400)))
    with pytest.raises(InputError, match="save its transpose"):
        read_frames(tmp_path / "folder")


def test_what_is_unclear_is_listed(tmp_path: Path) -> None:
    assert "a_0 (40, 3), b_0 (40, 3)" in refusal(
        saved(tmp_path, a_0=CLOUDS[0], b_0=CLOUDS[0], a_1=CLOUDS[1], b_1=STACK[0])
    )
    assert "lamp (40, 3)" in refusal(saved(tmp_path, lamp=CLOUDS[0], chair=CLOUDS[1]))
    assert "found 1 frame" in refusal(saved(tmp_path, points=CLOUDS[0], normals=CLOUDS[0]))
    assert "'notes.txt' is no array" in refusal(zipped(tmp_path / "b.npz", notes_txt=b"hello"))


def test_an_order_in_doubt_is_printed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        read_frames(saved(tmp_path, *CLOUDS))
        assert not caplog.records
        read_frames(saved(tmp_path, **{"t1.5": CLOUDS[0], "t1.25": CLOUDS[1]}))
    assert "in this order: t1.25, t1.5" in caplog.text


@pytest.mark.parametrize("shape", [(2, 400, 3), (2, 20, 3), (-2, 40, 3), (2, 10**15, 3)])
def test_a_header_that_declares_other_bytes_than_there_are_is_refused(tmp_path: Path, shape: tuple[int, ...]) -> None:
    path = zipped(tmp_path / "a.npz", points_npy=npy(shape, bytes(2 * 40 * 12)))
    assert "declares" in refusal(path)


def test_size_is_checked_before_reading_and_what_is_not_needed_is_not_read(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.npz", points_npy=npy((2, 5_000_000, 3), bytes(2 * 5_000_000 * 12)))
    tracemalloc.start()
    message = refusal(path, max_points=9_000_000)
    assert "found 10,000,000 points, expected at most 9,000,000 in all frames (ingest.max_points)" in message
    with pytest.raises(InputError, match="120,000,000 bytes, expected at most 1,000;"):
        load_npz(path, most_bytes=1000)
    assert load_npz(path, ("labels",)) == {}
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3_000_000


def test_a_member_that_lies_about_its_size_is_read_no_further(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.npz", points_npy=npy((2, 40, 3), bytes(10_000_000)))
    data = bytearray(path.read_bytes())
    entry = data.rfind(b"PK\x01\x02")
    data[entry + 24 : entry + 28] = struct.pack("<I", 128 + 2 * 40 * 12)
    path.write_bytes(data)
    assert "cannot be read as .npz" in refusal(path)


def test_a_folder_of_npz_with_one_cloud_each_is_a_sequence(tmp_path: Path) -> None:
    for index, cloud in enumerate(CLOUDS):
        np.savez(tmp_path / f"{index}.npz", points=cloud, normals=cloud)
    np.savez(tmp_path / "ground_truth.npz", labels=np.zeros((3, 40), dtype=int), poses=np.zeros((3, 2, 4, 4)))
    assert [len(frame.points) for frame in read_frames(tmp_path)] == [40, 50, 45]


def zeros(path: Path, **members: tuple[tuple[int, ...], object, bool]) -> Path:
    """An .npz of arrays of zeros by shape, type and whether they are in Fortran's order."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, (shape, of_type, fortran) in members.items():
            dtype = np.dtype(of_type)  # type: ignore[call-overload]
            with archive.open(f"{name}.npy", "w") as file:
                header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": fortran, "shape": shape}
                np.lib.format.write_array_header_1_0(file, header)
                file.write(bytes(dtype.itemsize * int(np.prod(shape))))
    return path


WIDE = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("rest", "V60000")]


@pytest.mark.parametrize(
    "members",
    [
        {"points": ((2, 400_000, 16), "f8", True)},
        {"points": ((2, 400_000, 16), "f8", False)},
        {"frame_0": ((400_000, 16), "f8", False), "frame_1": ((400_000, 16), "f8", True)},
        {"points": ((2, 800), WIDE, False)},
        {"points": ((2, 800), WIDE, True)},
    ],
    ids=["fortran", "rows", "clouds", "fields", "fields in fortran"],
)
def test_only_the_coordinates_and_a_block_are_held(
    tmp_path: Path, members: dict[str, tuple[tuple[int, ...], object, bool]]
) -> None:
    path = zeros(tmp_path / "a.npz", **members)
    tracemalloc.start()
    frames = read_frames(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    held = sum(frame.points.nbytes for frame in frames)
    assert not np.concatenate([frame.points for frame in frames]).any()
    assert peak < held + 50_000_000


def test_points_of_enormous_fields_are_refused(tmp_path: Path) -> None:
    fields = [*WIDE[:3], ("rest", "V300000")]
    assert "declares 300,012 bytes for each point" in refusal(
        zeros(tmp_path / "a.npz", points=((2, 40), fields, False))
    )


@pytest.mark.parametrize("step", [1, 2, 3])
def test_both_orders_give_the_same_points_over_several_blocks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    monkeypatch.setattr("stages.ingest.formats.arrays._BLOCK", 1000)
    fields = np.zeros(STACK.shape[:2], dtype=[("w", "i2"), ("z", "f8"), ("y", "f8"), ("x", "f8")])
    for index, axis in enumerate("xyz"):
        fields[axis] = STACK[..., index]
    for array in (STACK, np.asfortranarray(STACK), fields, np.asfortranarray(fields)):
        frames = read_frames(saved(tmp_path, points=array), step)
        np.testing.assert_array_equal([frame.points for frame in frames], STACK[::step])


@pytest.mark.parametrize("order", ["C", "F"])
def test_damage_beyond_the_coordinates_is_found(tmp_path: Path, order: str) -> None:
    path = saved(tmp_path, points=np.asarray(np.arange(4 * 40 * 9.0).reshape(4, 40, 9), order=order))  # type: ignore[call-overload]
    data = bytearray(path.read_bytes())
    data[data.rindex(np.float64(1439).tobytes())] ^= 1
    path.write_bytes(data)
    assert "CRC" in refusal(path)


@pytest.mark.parametrize("name", ["pos", "position", "points", "verts", "coord_"])
def test_positions_are_taken_and_normals_are_not(tmp_path: Path, name: str) -> None:
    arrays = {f"{name}{index}": cloud for index, cloud in enumerate(CLOUDS)}
    path = saved(tmp_path, **arrays, **{f"norm{index}": cloud for index, cloud in enumerate(CLOUDS)})
    assert names(path) == list(arrays)
