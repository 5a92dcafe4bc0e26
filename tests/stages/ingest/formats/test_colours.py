"""Colours of points, as the programs that write them have them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from stages.ingest.formats.cloud import Cloud, as_colours
from stages.ingest.point_formats import read_cloud

RNG = np.random.default_rng(0)
POINTS = RNG.normal(size=(40, 3)).round(4)
COLOURS = RNG.integers(256, size=(40, 3))
COLOURS[0] = 255
SHARES = (COLOURS / 255).round(6)


def table(*columns: np.ndarray, between: str = " ") -> str:
    rows = np.column_stack([np.asarray(column) for column in columns]).tolist()
    return "".join(between.join(f"{value:g}" for value in row) + "\n" for row in rows)


def read(folder: Path, name: str, content: str | bytes) -> Cloud:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_cloud(path)


def packed(colours: np.ndarray) -> np.ndarray:
    """Red, green and blue in 32 bits, as PCL has them."""
    red, green, blue = colours.astype(np.uint32).T
    return red << 16 | green << 8 | blue


def pcd(fields: str, sizes: str, types: str, data: str, body: bytes) -> bytes:
    head = f"VERSION 0.7\nFIELDS x y z {fields}\nSIZE 4 4 4 {sizes}\nTYPE F F F {types}\nCOUNT 1 1 1 1\n"
    return f"{head}WIDTH 40\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 40\nDATA {data}\n".encode() + body


def pcd_rows(dtype: str) -> bytes:
    rows = np.zeros(40, dtype=[("p", "<f4", 3), ("rgb", "<u4")])
    rows["p"], rows["rgb"] = POINTS, packed(COLOURS)
    return rows.tobytes()


TABLES = {
    "CloudCompare's text": ("a.txt", "//X Y Z R G B\n40\n" + table(POINTS, COLOURS)),
    "CloudCompare's shares": ("a.asc", "//X Y Z Rf Gf Bf\n" + table(POINTS, SHARES)),
    "csv": ("a.csv", "x,y,z,red,green,blue,label\n" + table(POINTS, COLOURS, COLOURS[:, 0], between=",")),
    "csv with an index": ("a.csv", ",x,y,z,r,g,b\n" + table(np.arange(40), POINTS, COLOURS, between=",")),
    "Open3D's xyzrgb": ("a.xyzrgb", table(POINTS, SHARES)),
    "Leica's pts": ("a.pts", "40\n" + table(POINTS, np.full(40, -1200), COLOURS)),
    "pts without intensity": ("a.pts", "40\n" + table(POINTS, COLOURS)),
    "PCL's text": ("a.pcd", pcd("rgb", "4", "U", "ascii", table(POINTS, packed(COLOURS)).encode())),
    "PCL's binary": ("a.pcd", pcd("rgb", "4", "F", "binary", pcd_rows("F"))),
    "PCL's binary with alpha": ("a.pcd", pcd("rgba", "4", "U", "binary", pcd_rows("U"))),
}


@pytest.mark.parametrize("kind", TABLES)
def test_colours_are_read_where_programs_write_them(tmp_path: Path, kind: str) -> None:
    if kind == "PCL's text":  # all digits of large whole numbers
        rows = zip(POINTS, packed(COLOURS), strict=True)
        body = "".join(f"{x} {y} {z} {rgb}\n" for (x, y, z), rgb in rows).encode()
        cloud = read(tmp_path, "a.pcd", pcd("rgb", "4", "U", "ascii", body))
    else:
        cloud = read(tmp_path, *TABLES[kind])
    np.testing.assert_allclose(cloud.points, POINTS, rtol=1e-5)
    np.testing.assert_array_equal(cloud.colours, COLOURS)
    assert cloud.colours is not None
    assert cloud.colours.dtype == np.uint8


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("normals.xyz", table(POINTS, POINTS)),
        ("normals.pts", "40\n" + table(POINTS, POINTS)),
        ("names.csv", "x,y,z,nx,ny,nz\n" + table(POINTS, POINTS, between=",")),
        ("intensity.pts", "40\n" + table(POINTS, np.full(40, -5))),
        ("some.csv", "x,y,z,r,g\n" + table(POINTS, COLOURS[:, :2], between=",")),
        ("negative.csv", "x,y,z,r,g,b\n" + table(POINTS, -SHARES, between=",")),
    ],
)
def test_what_are_no_colours_is_not_taken_for_them(tmp_path: Path, name: str, content: str) -> None:
    cloud = read(tmp_path, name, content)
    assert cloud.colours is None
    np.testing.assert_allclose(cloud.points, POINTS)


def test_files_of_open3d_come_back_with_their_colours(tmp_path: Path) -> None:
    o3d = pytest.importorskip("open3d")
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(POINTS))
    cloud.colors = o3d.utility.Vector3dVector(COLOURS / 255)
    for name, options in (
        ("a.ply", {}),
        ("b.ply", {"write_ascii": True}),
        ("a.pcd", {}),
        ("b.pcd", {"compressed": True}),
        ("a.xyzrgb", {}),
        ("a.pts", {}),
    ):
        o3d.io.write_point_cloud(str(tmp_path / name), cloud, **options)
        found = read_cloud(tmp_path / name)
        np.testing.assert_allclose(found.points, POINTS, atol=1e-6)
        np.testing.assert_allclose(np.asarray(found.colours, dtype=int), COLOURS, atol=1)


@pytest.mark.parametrize("kind", ["uchar", "float", "ushort"])
@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_colours_of_a_ply_are_of_any_type(tmp_path: Path, kind: str, encoding: str) -> None:
    values = {"uchar": COLOURS, "float": SHARES, "ushort": COLOURS * 257}[kind]
    code = {"uchar": "B", "float": "f", "ushort": "H"}[kind]
    names = "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    head = f"ply\nformat {encoding} 1.0\nelement vertex 40\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + names + "end_header\n"
    rows = b"".join(struct.pack(f"<3f3{code}", *p, *colour) for p, colour in zip(POINTS, values.tolist(), strict=True))
    body = table(POINTS, values).encode() if encoding == "ascii" else rows
    np.testing.assert_array_equal(read(tmp_path, "a.ply", head.encode() + body).colours, COLOURS)


def test_the_range_of_numbers_is_known_by_the_greatest() -> None:
    bytes_in_16_bits = np.array([[255, 0, 7]], dtype=np.uint16)
    np.testing.assert_array_equal(as_colours(bytes_in_16_bits), [[255, 0, 7]])
    np.testing.assert_array_equal(as_colours(bytes_in_16_bits * 257), [[255, 0, 7]])
    np.testing.assert_array_equal(as_colours(np.array([[1.0, 0.5, np.nan]])), [[255, 128, 0]])
    np.testing.assert_array_equal(as_colours(np.array([[1, 0, 1]], dtype=np.uint8)), [[1, 0, 1]])
    assert as_colours(np.array([[70000.0, 0, 0]])) is None
    assert as_colours(np.array([[-1.0, 0, 0]])) is None
    assert as_colours(np.zeros((0, 3))).shape == (0, 3)
