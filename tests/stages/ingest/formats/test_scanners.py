"""Files of laser scanners, as the libraries of their makers write them, and damaged ones."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from schemas.errors import InputError
from stages.ingest.messages import TooLargeError
from stages.ingest.point_formats import read_cloud

RNG = np.random.default_rng(0)
POINTS = RNG.normal(size=(300, 3)).astype(np.float32).astype(np.float64)
COLOURS = RNG.integers(256, size=(300, 3))
FAR = np.array([500_000.0, 4_000_000.0, 100.0])  # as surveyors have them


@pytest.fixture
def e57(tmp_path: Path) -> Path:
    """Two scans of one scanner at two places; the second saw nothing along some rays."""
    pye57 = pytest.importorskip("pye57")
    path = tmp_path / "two.e57"
    with pye57.E57(str(path), mode="w") as file:
        fields = {f"cartesian{axis}": POINTS[:, index] for index, axis in enumerate("XYZ")}
        fields |= {f"color{n}": COLOURS[:, i].astype(np.uint8) for i, n in enumerate(("Red", "Green", "Blue"))}
        file.write_scan_raw(fields, rotation=np.array([0.5, 0.5, 0.5, 0.5]), translation=np.array([1.0, 2, 3]))
        invalid = (np.arange(300) < 7).astype(np.int8)
        file.write_scan_raw(fields | {"cartesianInvalidState": invalid})
    return path


def las(path: Path, version: str = "1.2", point_format: int = 2, times: int = 256) -> Path:
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.offsets, header.scales = FAR, [1e-4] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = (POINTS + FAR).T
    if "red" in data.point_format.dimension_names:
        data.red, data.green, data.blue = times * COLOURS.T
    data.write(path)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_cloud(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_scans_of_an_e57_are_joined_in_their_common_coordinates(e57: Path) -> None:
    cloud = read_cloud(e57)
    turned = POINTS[:, [2, 0, 1]] + [1, 2, 3]  # (0.5, 0.5, 0.5, 0.5) takes x to y, y to z, and z to x
    np.testing.assert_allclose(cloud.points, np.concatenate([turned, POINTS[7:]]), atol=1e-5)
    np.testing.assert_array_equal(cloud.colours, np.concatenate([COLOURS, COLOURS[7:]]))


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize(("version", "point_format", "times"), [("1.2", 2, 256), ("1.2", 3, 1), ("1.4", 7, 256)])
def test_las_is_read_in_its_versions_packed_or_not(
    tmp_path: Path, suffix: str, version: str, point_format: int, times: int
) -> None:
    cloud = read_cloud(las(tmp_path / f"a{suffix}", version, point_format, times))
    np.testing.assert_allclose(cloud.points, POINTS + FAR, atol=1e-4)
    np.testing.assert_allclose(np.asarray(cloud.colours, dtype=int), COLOURS, atol=1)


def test_las_without_colours_has_none(tmp_path: Path) -> None:
    assert read_cloud(las(tmp_path / "a.las", point_format=0)).colours is None


def test_more_points_than_allowed_are_refused_by_what_is_declared(e57: Path, tmp_path: Path) -> None:
    for path in (e57, las(tmp_path / "a.las"), las(tmp_path / "a.laz")):
        with pytest.raises(TooLargeError):
            read_cloud(path, 299)


@pytest.mark.parametrize("kept", [0, 20, 100, 230, 1000, -1, -100])
def test_truncated_files_are_refused(e57: Path, tmp_path: Path, kept: int) -> None:
    for path in (e57, las(tmp_path / "a.las"), las(tmp_path / "b.las", "1.4", 7), las(tmp_path / "a.laz")):
        path.write_bytes(path.read_bytes()[:kept])
        refusal(path)


@pytest.mark.parametrize(
    ("at", "form", "value", "said"),
    [
        (107, "<I", 2**31, "of the 2147483648 points"),
        (96, "<I", 2**31, "from byte 2147483648"),
        (100, "<I", 2**31, "2147483648 records"),
        (105, "<H", 0, "las"),
        (94, "<H", 60000, "declared in"),
    ],
)
def test_a_las_that_declares_what_it_lacks_is_refused(
    tmp_path: Path, at: int, form: str, value: int, said: str
) -> None:
    path = las(tmp_path / "a.las")
    content = bytearray(path.read_bytes())
    struct.pack_into(form, content, at, value)
    path.write_bytes(content)
    with pytest.raises((InputError, TooLargeError)) as caught:
        read_cloud(path)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("at", "said"), [(16, "bytes that it declares"), (24, "XML section"), (32, "XML section"), (40, "XML section")]
)
def test_an_e57_whose_header_does_not_fit_is_refused(e57: Path, at: int, said: str) -> None:
    content = bytearray(e57.read_bytes())
    struct.pack_into("<Q", content, at, 2**40)
    e57.write_bytes(content)
    assert said in refusal(e57)


def test_an_e57_with_a_document_type_is_refused_before_it_is_parsed(e57: Path) -> None:
    content = e57.read_bytes()
    start = struct.unpack_from("<Q", content, 24)[0]
    place = content.index(b"<e57Root", start)
    e57.write_bytes(content[:place] + b"<!DOCTYPE x SYSTEM '/etc/passwd'>"[:33] + content[place + 33 :])
    assert "document type declaration" in refusal(e57)


def test_a_flipped_bit_of_an_e57_is_found(e57: Path) -> None:
    content = bytearray(e57.read_bytes())
    content[2000] ^= 1
    e57.write_bytes(content)
    refusal(e57)


@pytest.mark.parametrize(
    ("suffix", "package"), [(".e57", "pye57"), (".las", "laspy"), (".laz", "laspy"), (".laz", "lazrs")]
)
def test_without_the_extra_one_line_says_what_to_install(
    e57: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, package: str
) -> None:
    path = e57 if suffix == ".e57" else las(tmp_path / f"a{suffix}")
    monkeypatch.setitem(sys.modules, package, None)  # as if it were not installed
    message = refusal(path)
    assert f"takes the package {package}, which is not installed" in message
    assert "pip install rearticulate[scanners]" in message
