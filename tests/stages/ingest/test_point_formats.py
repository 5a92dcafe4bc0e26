from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from schemas.errors import InputError
from stages.ingest.messages import TooLargeError
from stages.ingest.point_formats import read_cloud

POINTS = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32).astype(np.float64)


def read_points(path: Path, most: int = sys.maxsize) -> np.ndarray:
    return read_cloud(path, most).points


def saved(tmp_path: Path, name: str, *pieces: str | bytes) -> Path:
    path = tmp_path / name
    path.write_bytes(b"".join(piece.encode() if isinstance(piece, str) else piece for piece in pieces))
    return path


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_points(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "; " in message
    assert "\n" not in message
    return message


def ply_header(encoding: str, count: int = 40, kind: str = "float", extra: str = "", newline: str = "\n") -> str:
    lines = ["ply", f"format {encoding} 1.0", "comment made by hand", f"element vertex {count}"]
    lines += [f"property {kind} {name}" for name in "xyz"] + extra.split("|") * bool(extra) + ["end_header", ""]
    return newline.join(lines)


def pcd_header(data: str, count: int = 40, **changes: str) -> str:
    entries = {"VERSION": "0.7", "FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F", "COUNT": "1 1 1"}
    entries |= {"WIDTH": str(count), "HEIGHT": "1", "POINTS": str(count)} | changes | {"DATA": data}
    return "# .PCD v0.7\n" + "".join(f"{key} {value}\n" for key, value in entries.items() if value)


def text(rows: np.ndarray) -> str:
    return "".join(" ".join(repr(float(value)) for value in row) + "\n" for row in rows)


def test_ply_is_read_in_each_encoding_and_precision(tmp_path: Path) -> None:
    for kind, dtype in (("float", "f4"), ("double", "f8"), ("float32", "f4"), ("float64", "f8")):
        for encoding, order in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
            path = saved(tmp_path, "a.ply", ply_header(encoding, kind=kind), POINTS.astype(order + dtype).tobytes())
            np.testing.assert_array_equal(read_points(path), POINTS)
            assert read_points(path).dtype == np.float64
    path = saved(tmp_path, "a.ply", ply_header("ascii", newline="\r\n"), text(POINTS).replace("\n", "\r\n"))
    np.testing.assert_array_equal(read_points(path), POINTS)


def test_ply_normals_colours_and_faces_are_ignored(tmp_path: Path) -> None:
    extra = "property float nx|property uchar red|element face 2|property list uchar int vertex_indices"
    record = np.zeros(40, dtype=[("p", "<f4", 3), ("nx", "<f4"), ("red", "u1")])
    record["p"], record["red"] = POINTS, 200
    faces = struct.pack("<B3i", 3, 0, 1, 2) * 2
    path = saved(tmp_path, "a.ply", ply_header("binary_little_endian", extra=extra), record.tobytes(), faces)
    np.testing.assert_array_equal(read_points(path), POINTS)
    rows = np.column_stack([POINTS, np.ones(40), np.full(40, 200)])
    path = saved(tmp_path, "a.ply", ply_header("ascii", extra=extra), text(rows), "3 0 1 2\n3 2 3 4\n")
    np.testing.assert_array_equal(read_points(path), POINTS)


def test_ply_columns_are_found_by_name_and_earlier_elements_are_skipped(tmp_path: Path) -> None:
    head = "ply\nformat {} 1.0\nelement camera 1\nproperty double focal\nelement vertex 2\n"
    head += "property uchar red\nproperty float z\nproperty float y\nproperty float x\nend_header\n"
    expected = [[3, 2, 1], [6, 5, 4]]
    path = saved(tmp_path, "a.ply", head.format("ascii"), "35.5\n9 1 2 3\n9 4 5 6\n")
    np.testing.assert_array_equal(read_points(path), expected)
    rows = struct.pack("<dB3fB3f", 35.5, 9, 1, 2, 3, 9, 4, 5, 6)
    path = saved(tmp_path, "a.ply", head.format("binary_little_endian"), rows)
    np.testing.assert_array_equal(read_points(path), expected)


def test_faces_before_the_vertices_are_skipped(tmp_path: Path) -> None:
    head = "ply\nformat {} 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 1\n"
    head += "property float x\nproperty float y\nproperty float z\nend_header\n"
    path = saved(tmp_path, "a.ply", head.format("ascii"), "3 0 1 2\n1 2 3\n")
    np.testing.assert_array_equal(read_points(path), [[1, 2, 3]])
    path = saved(tmp_path, "a.ply", head.format("binary_little_endian"), struct.pack("<B3i3f", 3, 0, 1, 2, 1, 2, 3))
    np.testing.assert_array_equal(read_points(path), [[1, 2, 3]])


def test_text_keeps_nan_and_infinity(tmp_path: Path) -> None:
    body = "1 2 3\nnan nan nan\n4 inf -inf\n"
    for path in (
        saved(tmp_path, "a.ply", ply_header("ascii", 3), body),
        saved(tmp_path, "a.pcd", pcd_header("ascii", 3), body),
        saved(tmp_path, "a.xyz", body),
    ):
        np.testing.assert_array_equal(read_points(path), [[1, 2, 3], [np.nan] * 3, [4, np.inf, -np.inf]])


@pytest.mark.parametrize("kept", [3, 30, 100, 300, 400])
def test_a_truncated_file_is_refused_in_each_format(tmp_path: Path, kept: int) -> None:
    whole = {
        "text.ply": ply_header("ascii") + text(POINTS),
        "binary.ply": ply_header("binary_little_endian").encode() + POINTS.astype("<f4").tobytes(),
        "text.pcd": pcd_header("ascii") + text(POINTS),
        "binary.pcd": pcd_header("binary").encode() + POINTS.astype("<f4").tobytes(),
    }
    for name, data in whole.items():
        path = saved(tmp_path, name, data)
        np.testing.assert_array_equal(read_points(path), POINTS)
        path.write_bytes(path.read_bytes()[:kept])
        message = refusal(path)
        assert "header" in message if kept <= 100 else "of the 40 points that it declares" in message


def test_text_garbage_is_refused_with_its_place(tmp_path: Path) -> None:
    bad = text(POINTS[:5]) + "1 two 3\n" + text(POINTS[6:])
    for path in (
        saved(tmp_path, "a.ply", ply_header("ascii"), bad),
        saved(tmp_path, "a.pcd", pcd_header("ascii"), bad),
        saved(tmp_path, "a.xyz", bad),
    ):
        message = refusal(path)
        assert "'two'" in message
        assert "row 5" in message
    ragged = text(POINTS[:5]) + "1 2\n" + text(POINTS[6:])
    for path in (saved(tmp_path, "a.ply", ply_header("ascii"), ragged), saved(tmp_path, "a.xyz", ragged)):
        assert "columns changed from 3 to 2 at row" in refusal(path)


def test_files_that_are_something_else_are_refused(tmp_path: Path) -> None:
    for name in ("a.ply", "a.pcd", "a.npy"):
        refusal(saved(tmp_path, name, b""))
        refusal(saved(tmp_path, name, "<html>not found</html>\n"))
        refusal(saved(tmp_path, name, bytes(range(256)) * 4))
    refusal(saved(tmp_path, "a.xyz", bytes(range(256)) * 4))
    assert "2 columns" in refusal(saved(tmp_path, "a.xyz", "1 2\n3 4\n"))


@pytest.mark.parametrize(
    "header",
    [
        ply_header("ascii", extra="property list uchar int neighbours"),
        ply_header("ascii", kind="quaternion"),
        ply_header("ascii").replace("property float z\n", ""),
        ply_header("ascii").replace("element vertex 40", "element vertex many"),
        ply_header("ascii").replace("element vertex 40", "element vertex -1"),
        ply_header("ascii").replace("element vertex", "element face"),
        ply_header("middle_endian"),
        ply_header("binary_little_endian", 400_000_000_000),
        ply_header("ascii", 400_000_000_000),
    ],
)
def test_impossible_ply_headers_are_refused(tmp_path: Path, header: str) -> None:
    refusal(saved(tmp_path, "a.ply", header, text(POINTS)))


def test_pcd_is_read_in_each_encoding_and_type(tmp_path: Path) -> None:
    text_file = saved(tmp_path, "a.pcd", pcd_header("ascii"), text(POINTS))
    np.testing.assert_array_equal(read_points(text_file), POINTS)
    doubles = pcd_header("binary", SIZE="8 8 8")
    np.testing.assert_array_equal(read_points(saved(tmp_path, "a.pcd", doubles, POINTS.tobytes())), POINTS)
    record = np.zeros(40, dtype=[("rgb", "<u4"), ("normal", "<f4", 3), ("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    for index, name in enumerate("xyz"):
        record[name] = POINTS[:, index]
    layout = {"FIELDS": "rgb normal x y z", "SIZE": "4 4 4 4 4", "TYPE": "U F F F F", "COUNT": "1 3 1 1 1"}
    path = saved(tmp_path, "a.pcd", pcd_header("binary", POINTS="", **layout), record.tobytes())
    np.testing.assert_array_equal(read_points(path), POINTS)
    rows = np.column_stack([np.ones((40, 4)), POINTS])
    path = saved(tmp_path, "a.pcd", pcd_header("ascii", **layout), text(rows))
    np.testing.assert_array_equal(read_points(path), POINTS)


def test_compressed_pcd_is_read_and_its_damage_is_noticed(tmp_path: Path) -> None:
    columns = POINTS.astype("<f4").T.tobytes()
    literal = b"".join(  # LZF may store runs of up to 32 bytes as they are
        bytes([len(run) - 1]) + run for run in (columns[start : start + 32] for start in range(0, len(columns), 32))
    )
    sizes = struct.pack("<II", len(literal), len(columns))
    header = pcd_header("binary_compressed")
    np.testing.assert_array_equal(read_points(saved(tmp_path, "a.pcd", header, sizes, literal)), POINTS)
    refusal(saved(tmp_path, "a.pcd", header, sizes, literal[:-40]))
    refusal(saved(tmp_path, "a.pcd", header, sizes[:4]))
    refusal(saved(tmp_path, "a.pcd", header, struct.pack("<II", len(literal), 2**31), literal))
    refusal(saved(tmp_path, "a.pcd", header, sizes, b"\xff" * len(literal)))


@pytest.mark.parametrize(
    "changes",
    [
        {"FIELDS": "x y"},
        {"FIELDS": "x y w"},
        {"TYPE": "F F Q"},
        {"SIZE": "4 4 400"},
        {"COUNT": "1 1 0"},
        {"COUNT": "1 1 999999999999"},
        {"POINTS": "400000000000"},
        {"POINTS": "-1"},
        {"POINTS": "", "WIDTH": ""},
    ],
)
def test_impossible_pcd_headers_are_refused(tmp_path: Path, changes: dict[str, str]) -> None:
    for data in ("ascii", "binary", "binary_compressed", "zipped"):
        refusal(saved(tmp_path, "a.pcd", pcd_header(data, **changes), text(POINTS)))


def test_xyz_takes_the_first_three_columns_and_skips_comments(tmp_path: Path) -> None:
    path = saved(tmp_path, "a.xyz", "# x y z intensity\n\n1 2\t3 0.5\n  4 5 6 0.5 # last\n")
    np.testing.assert_array_equal(read_points(path), [[1, 2, 3], [4, 5, 6]])


def test_npy_of_integers_and_any_float_is_converted(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    for dtype in ("i2", "u1", "f2", "f4", ">f8"):
        np.save(path, np.arange(12).reshape(4, 3).astype(dtype))
        np.testing.assert_array_equal(read_points(path), np.arange(12).reshape(4, 3))
        assert read_points(path).dtype == np.float64


def test_npy_of_other_shapes_and_types_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    for array, found in (
        (np.zeros((40, 2)), "(40, 2)"),
        (np.zeros(120), "(120,)"),
        (np.zeros((5, 40, 3)), "(5, 40, 3)"),
        (np.zeros((40, 3), complex), "complex128"),
        (np.zeros((40, 3), bool), "bool"),
        (np.full((40, 3), "a"), "U1"),
        (np.full((40, 3), None), "objects"),
    ):
        np.save(path, array)
        assert found in refusal(path)


def test_a_truncated_npy_is_refused_without_allocating_what_it_declares(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, POINTS)
    path.write_bytes(path.read_bytes()[:-8])
    refusal(path)
    np.save(path, POINTS)
    header = path.read_bytes()[:128].replace(b"(40, 3)", b"(9999999999999, 3)").replace(b"}           ", b"} ")
    path.write_bytes(header[:127].ljust(127) + b"\n")
    refusal(path)


def test_a_mark_of_utf_8_capitals_and_utf_16_in_headers(tmp_path: Path) -> None:
    mark = b"\xef\xbb\xbf"
    for name, header in (("a.ply", ply_header("binary_little_endian")), ("a.pcd", pcd_header("binary"))):
        for data in (
            mark + header.encode(),
            header.replace(" x", " X").replace(" y", " Y").replace(" z", " Z").encode(),
        ):
            path = saved(tmp_path, name, data, POINTS.astype("<f4").tobytes())
            np.testing.assert_array_equal(read_points(path), POINTS)
        assert "UTF-16" in refusal(saved(tmp_path, name, header.encode("utf-16")))


@pytest.mark.parametrize("lengths", [[2] * 40, [0, 1, 3, 2] * 10], ids=["of one length", "of any length"])
@pytest.mark.parametrize("first", [True, False], ids=["before", "after"])
def test_ply_lists_on_vertices_are_skipped(tmp_path: Path, lengths: list[int], first: bool) -> None:
    properties = ["property list uchar int seen_by", *(f"property float {name}" for name in "xyz")]
    columns = "\n".join(properties if first else properties[1:] + properties[:1])
    head = "ply\nformat {} 1.0\nelement vertex 40\n" + columns + "\nend_header\n"
    for encoding, order in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        lists = [struct.pack(f"{order}B{length}i", length, *range(length)) for length in lengths]
        points = [point.astype(order + "f4").tobytes() for point in POINTS]
        rows = [a + b if first else b + a for a, b in zip(lists, points, strict=True)]
        path = saved(tmp_path, "a.ply", head.format(encoding), b"".join(rows))
        np.testing.assert_array_equal(read_points(path), POINTS)
        path.write_bytes(path.read_bytes()[:-1])
        refusal(path)
    texts = [" ".join(map(str, [length, *range(length)])) for length in lengths]
    lines = zip(texts, text(POINTS).splitlines(), strict=True)
    body = "".join(f"{a} {b}\n" if first else f"{b} {a}\n" for a, b in lines)
    np.testing.assert_array_equal(read_points(saved(tmp_path, "a.ply", head.format("ascii"), body)), POINTS)


def test_ply_faces_of_any_size_may_come_before_the_vertices(tmp_path: Path) -> None:
    head = ply_header("binary_little_endian").replace(
        "element vertex", "element face 3\nproperty list uchar int vertex_indices\nelement vertex"
    )
    faces = struct.pack("<B3iB4iB3i", 3, 0, 1, 2, 4, 0, 1, 2, 3, 3, 0, 1, 2)
    path = saved(tmp_path, "a.ply", head, faces, POINTS.astype("<f4").tobytes())
    np.testing.assert_array_equal(read_points(path), POINTS)
    for bad in (struct.pack("<B", 255), b""):
        refusal(saved(tmp_path, "a.ply", head, bad))


def test_ply_that_names_a_property_or_an_element_twice_is_refused(tmp_path: Path) -> None:
    header = ply_header("ascii", extra="property float x")
    assert "the column x twice" in refusal(saved(tmp_path, "a.ply", header, text(POINTS)))
    header = ply_header("ascii", extra="element vertex 3|property float x")
    assert "the element vertex twice" in refusal(saved(tmp_path, "a.ply", header, text(POINTS)))


def test_pcd_that_contradicts_itself_is_refused(tmp_path: Path) -> None:
    body = POINTS.astype("<f4").tobytes()
    message = refusal(saved(tmp_path, "a.pcd", pcd_header("binary", WIDTH="20"), body))
    assert "POINTS 40, but WIDTH 20 x HEIGHT 1" in message
    organised = saved(tmp_path, "a.pcd", pcd_header("binary", WIDTH="8", HEIGHT="5"), body)
    np.testing.assert_array_equal(read_points(organised), POINTS)
    twice = pcd_header("binary", FIELDS="x x y z", SIZE="4 4 4 4", TYPE="F F F F", COUNT="1 1 1 1")
    assert "the column x twice" in refusal(saved(tmp_path, "a.pcd", twice, body * 2))
    several = pcd_header("binary", COUNT="2 1 1")
    assert "several values of x" in refusal(saved(tmp_path, "a.pcd", several, body * 2))


def test_pcd_padding_fields_may_repeat(tmp_path: Path) -> None:
    layout = {"FIELDS": "x y z _ rgb _", "SIZE": "4 4 4 1 4 1", "TYPE": "F F F U F U", "COUNT": "1 1 1 4 1 12"}
    body = b"".join(point.astype("<f4").tobytes() + bytes(20) for point in POINTS)
    np.testing.assert_array_equal(read_points(saved(tmp_path, "a.pcd", pcd_header("binary", **layout), body)), POINTS)


@pytest.mark.parametrize(
    "error", [OSError("libusb-1.0.so.0: cannot open"), ImportError("none"), AttributeError("_ARRAY")]
)
def test_open3d_that_cannot_be_loaded_is_named_with_another_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    class Broken:
        def find_spec(self, name: str, *_: object) -> None:
            if name == "open3d":
                raise error

    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    path = saved(tmp_path, "a.pcd", pcd_header("binary_compressed"), struct.pack("<II", 480, 480), bytes(480))
    with pytest.raises(InputError) as caught:
        read_points(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "Open3D cannot be loaded" in message
    assert str(error) in message
    assert "uncompressed PCD or as PLY" in message
    assert "export it again" not in message


def test_more_points_than_allowed_are_refused_by_what_is_declared(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", POINTS)
    body = POINTS.astype("<f4").tobytes()
    files = (
        saved(tmp_path, "a.ply", ply_header("binary_little_endian"), body),
        saved(tmp_path, "b.ply", ply_header("ascii"), text(POINTS)),
        saved(tmp_path, "a.pcd", pcd_header("binary"), body),
        saved(tmp_path, "b.pcd", pcd_header("ascii"), text(POINTS)),
        saved(tmp_path, "c.pcd", pcd_header("binary_compressed"), struct.pack("<II", 9, 480)),
        tmp_path / "a.npy",
    )
    for path in files:
        with pytest.raises(TooLargeError, match="found 40 points"):
            read_points(path, 39)


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".xyz", ".csv", ".npy", ".npz"])
def test_a_file_that_cannot_be_opened_is_not_called_damaged(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.mkdir()  # as root every file may be read, but no folder
    with pytest.raises(InputError, match=r"a\.\w+: cannot be read \(Is a directory\); check its permissions"):
        read_points(path)


def test_too_little_memory_is_not_called_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def exhausted(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(np, "stack", exhausted)
    path = saved(tmp_path, "a.ply", ply_header("binary_little_endian"), POINTS.astype("<f4").tobytes())
    with pytest.raises(InputError, match="takes more memory than there is"):
        read_points(path)
