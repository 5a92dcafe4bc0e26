"""Depth images as Open3D, TUM and ScanNet lay them out; and what does not fit together."""

from __future__ import annotations

import io
import json
import shutil
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from schemas.config import DepthImagesConfig, IngestConfig
from schemas.errors import InputError
from schemas.sequence import IngestedSequence
from stages.ingest.depth_folder import depth_files, is_depth_folder, read_depth_frames
from stages.ingest.file_source import file_source
from stages.ingest.readers import Frame
from stages.ingest.sources import list_sources

ROWS, COLUMNS = 24, 32
FX, FY, CX, CY = 30.0, 31.0, 15.5, 11.25
OPEN3D = {"width": COLUMNS, "height": ROWS, "intrinsic_matrix": [FX, 0.0, 0.0, 0.0, FY, 0.0, CX, CY, 1.0]}
CONFIG = DepthImagesConfig()


def depth(t: int = 0) -> np.ndarray:
    """A slanted wall behind a block that moves; zeros where nothing was seen. Millimetres."""
    image = np.tile(1200 + 5 * np.arange(COLUMNS), (ROWS, 1)).astype(np.uint16)
    image[8:16, 4 + 3 * t : 12 + 3 * t] = 800
    image[:3] = 0
    return image


def points(image: np.ndarray) -> np.ndarray:
    """The points of an image in millimetres, in camera coordinates."""
    v, u = np.nonzero(image)
    z = image[v, u] / 1000
    return np.stack([(u - CX) * z / FX, (v - CY) * z / FY, z], axis=1)


def save(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, image) if path.suffix == ".npy" else Image.fromarray(image).save(path)


def sequence(folder: Path, frames: int = 3, names: str = "{:04d}.png") -> Path:
    """As Open3D's examples have it, with the intrinsics in its JSON."""
    for t in range(frames):
        save(folder / "depth" / names.format(t), depth(t))
    (folder / "intrinsics.json").write_text(json.dumps(OPEN3D))
    return folder


def pose(t: int) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.1 * t, -0.3, 0.2 * t]).as_matrix()
    T[:3, 3] = [t, 2 * t, -0.5]
    return T


def moved(T: np.ndarray, p: np.ndarray) -> np.ndarray:
    return p @ T[:3, :3].T + T[:3, 3]


def read(folder: Path, **settings: object) -> list[Frame]:
    return read_depth_frames(folder, DepthImagesConfig.model_validate(settings), 1, 10**6)


def refusal(folder: Path) -> str:
    with pytest.raises(InputError) as caught:
        read(folder)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(folder))
    return str(caught.value)


def test_images_of_a_still_camera_become_points_in_its_coordinates(tmp_path: Path) -> None:
    frames = read(sequence(tmp_path))
    assert [frame.name for frame in frames] == ["depth/0000", "depth/0001", "depth/0002"]
    for t, frame in enumerate(frames):
        np.testing.assert_allclose(frame.points, points(depth(t)), atol=1e-12)
        np.testing.assert_array_equal(frame.viewpoints, [[0, 0, 0]])
        assert frame.colours is None


def test_points_are_where_open3d_has_them(tmp_path: Path) -> None:
    o3d = pytest.importorskip("open3d")
    (first, *_) = read(sequence(tmp_path))
    camera = o3d.camera.PinholeCameraIntrinsic(COLUMNS, ROWS, FX, FY, CX, CY)
    cloud = o3d.geometry.PointCloud.create_from_depth_image(
        o3d.geometry.Image(depth()), camera, depth_scale=1000, depth_trunc=100
    )
    np.testing.assert_allclose(first.points, np.asarray(cloud.points), atol=1e-5)
    written = str(tmp_path / "intrinsics.json")
    o3d.io.write_pinhole_camera_intrinsic(written, camera)
    np.testing.assert_allclose(read(tmp_path)[0].points, first.points, atol=1e-12)


def test_real_numbers_are_metres_and_nan_is_no_depth(tmp_path: Path) -> None:
    sequence(tmp_path, names="{:04d}.npy")
    for t in range(3):
        metres = depth(t).astype(np.float32) / 1000
        metres[:3, 0], metres[:3, 1], metres[:3, 2] = np.nan, np.inf, -1
        np.save(tmp_path / "depth" / f"{t:04d}.npy", metres)
    np.testing.assert_allclose(read(tmp_path)[1].points, points(depth(1)), atol=1e-6)


@pytest.mark.parametrize(
    "text",
    [
        f"{FX} {FY} {CX} {CY}\n",
        f"# fx fy cx cy\n{FX}, {FY}, {CX}, {CY}\n",
        f"{FX} {FY} {CX} {CY} 0 0 0 0 0",
        f"{FX} 0 {CX}\n0 {FY} {CY}\n0 0 1\n",
        f"{FX} 0 {CX} 0\n0 {FY} {CY} 0\n0 0 1 0\n0 0 0 1\n",  # ScanNet's
    ],
)
def test_intrinsics_are_read_as_tum_and_others_write_them(tmp_path: Path, text: str) -> None:
    sequence(tmp_path)
    (tmp_path / "intrinsics.json").unlink()
    (tmp_path / "intrinsics.txt").write_text(text)
    np.testing.assert_allclose(read(tmp_path)[0].points, points(depth()), atol=1e-12)


def test_tums_images_and_trajectory_are_matched_by_time(tmp_path: Path) -> None:
    """Names are times, the trajectory has more poses than there are images, and 5000 steps are a metre."""
    times = [1305031102.160407, 1305031102.194330, 1305031102.226738]
    for t, time in enumerate(times):
        save(tmp_path / "depth" / f"{time:.6f}.png", (5 * depth(t)).astype(np.uint16))
    (tmp_path / "intrinsics.txt").write_text(f"{FX} {FY} {CX} {CY}")
    lines = ["# ground truth trajectory", "# timestamp tx ty tz qx qy qz qw"]
    for step in range(-3, 30):
        T = pose(step)
        q = Rotation.from_matrix(T[:3, :3]).as_quat()
        stamp = times[step] - 0.003 if 0 <= step < 3 else times[0] + 0.1 + 0.05 * step if step > 2 else times[0] + step
        lines.append(" ".join(f"{value:.4f}" for value in [stamp, *T[:3, 3], *q]))
    (tmp_path / "poses.txt").write_text("\n".join(lines))
    frames = read(tmp_path, units_per_metre=5000)
    for t, frame in enumerate(frames):
        np.testing.assert_allclose(frame.points, moved(pose(t), points(depth(t))), atol=1e-3)
        np.testing.assert_allclose(frame.viewpoints, [pose(t)[:3, 3]], atol=1e-4)


@pytest.mark.parametrize("kind", ["npy", "lines of 16", "lines of 12", "matrices", "one file each"])
def test_poses_of_all_images_come_in_their_order(tmp_path: Path, kind: str) -> None:
    sequence(tmp_path)
    Ts = np.stack([pose(t) for t in range(3)])
    if kind == "npy":
        np.save(tmp_path / "poses.npy", Ts)
    elif kind == "one file each":  # ScanNet's and 7-Scenes'
        (tmp_path / "poses").mkdir()
        for t in range(3):
            np.savetxt(tmp_path / "poses" / f"{t:04d}.txt", Ts[t])
    else:
        table = {"lines of 16": Ts.reshape(3, 16), "lines of 12": Ts[:, :3].reshape(3, 12)}.get(kind, Ts.reshape(-1, 4))
        np.savetxt(tmp_path / "poses.txt", table)
    for t, frame in enumerate(read(tmp_path)):
        np.testing.assert_allclose(frame.points, moved(Ts[t], points(depth(t))), atol=1e-9)
        np.testing.assert_allclose(frame.viewpoints, Ts[t, None, :3, 3])


def rig(folder: Path, cameras: tuple[str, ...] = ("left", "right"), states: int = 3) -> Path:
    """Several cameras around each state, which stand still and have intrinsics of their own."""
    for t in range(states):
        for index, camera in enumerate(cameras):
            save(folder / "depth" / f"state_{t}" / f"{camera}.png", depth(t + index))
    for index, camera in enumerate(cameras):
        for inner, text in (("intrinsics", json.dumps(OPEN3D)), ("poses", "")):
            (folder / inner).mkdir(exist_ok=True)
            (folder / inner / f"{camera}.json").write_text(text)
        np.savetxt(folder / "poses" / f"{camera}.txt", pose(index))
    return folder


def test_several_cameras_of_a_state_are_one_frame(tmp_path: Path) -> None:
    frames = read(rig(tmp_path))
    assert [frame.name for frame in frames] == ["depth/state_0", "depth/state_1", "depth/state_2"]
    for t, frame in enumerate(frames):
        both = [moved(pose(index), points(depth(t + index))) for index in range(2)]
        np.testing.assert_allclose(frame.points, np.concatenate(both), atol=1e-9)
        np.testing.assert_allclose(frame.viewpoints, [pose(0)[:3, 3], pose(1)[:3, 3]])


def test_frames_with_fewer_cameras_repeat_the_last_viewpoint(tmp_path: Path) -> None:
    rig(tmp_path)
    (tmp_path / "depth" / "state_1" / "right.png").unlink()
    frames = read(tmp_path)
    np.testing.assert_allclose(frames[1].viewpoints, [pose(0)[:3, 3]] * 2)
    assert len(frames[1].points) < len(frames[0].points)


def test_masks_leave_only_the_object(tmp_path: Path) -> None:
    sequence(tmp_path)
    for t, kind in enumerate(("L", "RGBA", "npy")):
        mask = depth(t) == 800
        if kind == "npy":
            save(tmp_path / "mask" / f"{t:04d}.npy", mask)
        elif kind == "L":
            save(tmp_path / "mask" / f"{t:04d}.png", 255 * mask.astype(np.uint8))
        else:  # a cut-out: the background is transparent
            save(
                tmp_path / "mask" / f"{t:04d}.png",
                np.stack([np.full_like(mask, 200, np.uint8)] * 3 + [255 * mask.astype(np.uint8)], 2),
            )
    for frame in read(tmp_path):
        np.testing.assert_allclose(frame.points[:, 2], 0.8)
        assert len(frame.points) == 64


@pytest.mark.parametrize("inner", ["color", "rgb"])
def test_pictures_give_the_points_their_colours(tmp_path: Path, inner: str, caplog: pytest.LogCaptureFixture) -> None:
    sequence(tmp_path)
    pictures = np.random.default_rng(0).integers(256, size=(3, ROWS, COLUMNS, 3)).astype(np.uint8)
    for t in range(3):
        save(tmp_path / inner / f"{t:04d}.png", pictures[t])
    for t, frame in enumerate(read(tmp_path)):
        np.testing.assert_array_equal(frame.colours, pictures[t][depth(t) > 0])
    save(tmp_path / inner / "0001.png", pictures[1][:-1])
    assert [frame.colours is None for frame in read(tmp_path)] == [False, True, False]
    assert "another size" in caplog.text


def test_every_so_many_th_pixel_and_the_near_ones_may_do(tmp_path: Path) -> None:
    sequence(tmp_path)
    strided = np.zeros_like(depth())
    strided[::3, ::3] = depth()[::3, ::3]
    np.testing.assert_allclose(read(tmp_path, stride=3)[0].points, points(strided), atol=1e-12)
    assert read(tmp_path, farthest=1.0)[0].points[:, 2].max() == pytest.approx(0.8)


def test_such_a_folder_is_a_sequence_in_metres_with_known_viewpoints(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "data" / "lamp")
    np.save(folder / "poses.npy", np.stack([pose(t) for t in range(3)]))
    rng = np.random.default_rng(0)
    (listed,) = list_sources(IngestConfig(), tmp_path / "data")
    for source in (listed, file_source(folder)):
        assert source.name == "lamp"
        ingested = source.load(IngestConfig(), rng)
        assert isinstance(ingested, IngestedSequence)
        assert ingested.sequence.units == "metre"
        viewpoints = ingested.sequence.to_input(ingested.sequence.viewpoints)
        np.testing.assert_allclose(viewpoints, [[pose(t)[:3, 3]] for t in range(3)], atol=1e-9)
    for settings, said in (({"units": "millimetre"}, "expected metre"), ({"viewpoint": (0, 0, 0)}, "--viewpoint")):
        with pytest.raises(InputError, match=said):
            file_source(folder).load(IngestConfig.model_validate(settings), rng)


def test_each_file_counts_in_the_digest(tmp_path: Path) -> None:
    folder = rig(tmp_path / "rig")
    digests = {file_source(folder).digest()}
    for file in depth_files(folder):
        before = file.read_bytes()
        file.write_bytes(before + b" ")
        digests.add(file_source(folder).digest())
        file.write_bytes(before)
    shutil.move(folder / "poses" / "left.txt", folder / "poses" / "centre.txt")
    digests.add(file_source(folder).digest())
    assert len(digests) == 2 + len(depth_files(folder)) == 2 + 6 + 4 + 2


def test_a_folder_without_intrinsics_is_told_what_it_lacks(tmp_path: Path) -> None:
    sequence(tmp_path)
    (tmp_path / "intrinsics.json").unlink()
    assert is_depth_folder(tmp_path)
    assert "without the camera's intrinsics, expected intrinsics.json" in refusal(tmp_path)
    np.save(tmp_path / "0.npy", np.ones((3, 3)))  # frames of its own; depth/ is something else
    assert not is_depth_folder(tmp_path)


def damaged_png() -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(depth()).save(buffer, "PNG")
    return buffer.getvalue()[:-40]


def huge_png() -> bytes:
    """A few bytes that declare 65535 x 65535 pixels."""
    head = struct.pack(">IIBBBBB", 65535, 65535, 16, 0, 0, 0, 0)
    chunks = b""
    for kind, data in ((b"IHDR", head), (b"IDAT", zlib.compress(bytes(100))), (b"IEND", b"")):
        chunks += struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return b"\x89PNG\r\n\x1a\n" + chunks


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("depth/0001.png", damaged_png(), "damaged image"),
        ("depth/0001.png", huge_png(), "pixels"),
        ("depth/0001.png", b"%!PS-Adobe-3.0 EPSF-3.0\n", "no image of the kinds PNG"),
        ("depth/0001.png", b"", "no image"),
        ("intrinsics.json", b"{}", "intrinsic_matrix"),
        ("intrinsics.json", b"[" * 100_000, "deeply"),
        ("intrinsics.json", json.dumps(OPEN3D | {"width": 999}).encode(), "(999, 24)"),
        (
            "intrinsics.json",
            json.dumps(OPEN3D | {"intrinsic_matrix": [1, 2, 3, 4, 5, 6, 7, 8, 9]}).encode(),
            "camera matrix",
        ),
        ("intrinsics.json", json.dumps(OPEN3D | {"intrinsic_matrix": [0, 0, 0, 0, 1, 0, 1, 1, 1]}).encode(), "fx 0"),
        ("intrinsics.txt", b"30 31 15 11", "expected one of them"),
        ("poses.txt", b"0 0 0 0 0 0 0 1\n", "found 1 poses of 3 depth images"),
        ("poses.txt", b"0 0 0 0 0 0 0 2\n" * 3, "quaternion"),
        ("poses.txt", b"1 2 3\n" * 3, "lines of 3 numbers"),
        ("poses.txt", b"0 0 0 0 0 0 0 one\n" * 3, "one"),
        ("poses.txt", b"2 0 0 0 0 2 0 0 0 0 2 0\n" * 3, "no rigid motion"),
        ("poses.txt", b"nan 0 0 0 0 2 0 0 0 0 2 0\n" * 3, "no rigid motion"),
        ("poses.txt", b"", "or none"),
        ("poses.npy", b"\x93NUMPY", "header"),
    ],
)
def test_files_that_are_damaged_or_do_not_fit_are_one_line(
    tmp_path: Path, name: str, content: bytes, said: str
) -> None:
    sequence(tmp_path)
    (tmp_path / name).write_bytes(content)
    assert said in refusal(tmp_path)


def test_images_of_another_kind_are_refused(tmp_path: Path) -> None:
    sequence(tmp_path)
    save(tmp_path / "depth" / "0001.png", (depth() // 8).astype(np.uint8))
    assert "of 8 bits, expected 16 bits of grey" in refusal(tmp_path)
    save(tmp_path / "depth" / "0001.png", np.zeros((ROWS, COLUMNS, 3), dtype=np.uint8))
    assert "an image of colours" in refusal(tmp_path)
    (tmp_path / "depth" / "0001.png").unlink()
    np.save(tmp_path / "depth" / "0001.npy", np.zeros((5, ROWS, COLUMNS)))
    assert "(5, 24, 32)" in refusal(tmp_path)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    sequence(tmp_path)
    (tmp_path / "mask").mkdir()
    assert "0000.png: found nothing of its name in" in refusal(tmp_path)
    save(tmp_path / "mask" / "0000.png", np.zeros((ROWS, COLUMNS + 1), dtype=np.uint8))
    assert "0000.png: found a mask of shape (24, 33)" in refusal(tmp_path)
    shutil.rmtree(tmp_path / "mask")
    shutil.copytree(tmp_path / "depth", tmp_path / "depth" / "state_9")
    assert "images and folders" in refusal(tmp_path)


def test_several_cameras_need_poses(tmp_path: Path) -> None:
    rig(tmp_path)
    shutil.rmtree(tmp_path / "poses")
    assert "right.png: found a second camera of the frame 'state_0' without poses" in refusal(tmp_path)


def test_an_image_twice_and_too_few_or_too_large_frames_are_refused(tmp_path: Path) -> None:
    sequence(tmp_path)
    np.save(tmp_path / "depth" / "0001.npy", depth() / 1000.0)
    assert "twice" in refusal(tmp_path)
    (tmp_path / "depth" / "0001.npy").unlink()
    with pytest.raises(InputError, match=r"0001\.png: found 672 points and 672 in the frames before"):
        read_depth_frames(tmp_path, CONFIG, 1, 1000)
    assert len(read_depth_frames(tmp_path, CONFIG, 2, 1400)) == 2
    for t in (1, 2):
        (tmp_path / "depth" / f"{t:04d}.png").unlink()
    assert "found 1 frame, expected at least 2" in refusal(tmp_path)


def test_a_known_viewpoint_of_ordinary_clouds_is_kept(tmp_path: Path) -> None:
    for t in range(2):
        np.save(tmp_path / f"{t}.npy", np.random.default_rng(t).normal(size=(50, 3)))
    source, rng = file_source(tmp_path), np.random.default_rng(0)
    sequence = source.load(IngestConfig(viewpoint=(1.0, -2.0, 3.0)), rng).sequence
    np.testing.assert_allclose(sequence.to_input(sequence.viewpoints), [[[1, -2, 3]]] * 2)
    assert source.load(IngestConfig(), rng).sequence.viewpoints is None


@pytest.mark.parametrize(("every", "expected"), [(1, 5), (2, 3)])
def test_the_count_of_frames_is_known_before_they_are_read(tmp_path: Path, every: int, expected: int) -> None:
    source = file_source(sequence(tmp_path / "still", frames=5))
    assert source.frame_count(IngestConfig(every=every)) == expected == len(read(tmp_path / "still")[::every])
