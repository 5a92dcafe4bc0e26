from __future__ import annotations

import logging
import sys
from pathlib import Path

import numpy as np
import pytest

from schemas.errors import InputError
from stages.ingest.formats.tables import looks_like_table
from stages.ingest.messages import TooLargeError
from stages.ingest.point_formats import read_cloud
from stages.ingest.readers import read_frames

POINTS = np.random.default_rng(0).normal(size=(40, 3)).round(4)
COLOURED = np.column_stack([POINTS, np.full((40, 3), 200)])


def read_points(path: Path, most: int = sys.maxsize) -> np.ndarray:
    return read_cloud(path, most).points


def rows(values: np.ndarray = POINTS, between: str = " ", form: str = "%.4f") -> str:
    return "".join(between.join(form % value for value in row) + "\n" for row in values)


def counted(between: str, first: int = 0, quote: str = "") -> str:
    lines = rows(between=between).splitlines()
    return "".join(f"{quote}{index}{quote}{between}{line}\n" for index, line in enumerate(lines, first))


def read(folder: Path, text: str, suffix: str = ".txt", encoding: str = "utf-8") -> np.ndarray:
    path = folder / f"cloud{suffix}"
    path.write_bytes(text.encode(encoding))
    return read_points(path)


def refusal(folder: Path, text: str, encoding: str = "utf-8") -> str:
    with pytest.raises(InputError) as caught:
        read(folder, text, encoding=encoding)
    assert "\n" not in str(caught.value)
    return str(caught.value)


TABLES = {
    "commas": rows(between=","),
    "commas and spaces": rows(between=", "),
    "semicolons": rows(between=";"),
    "tabs": rows(between="\t"),
    "fixed width": rows(form="%12.4f"),
    "trailing commas": rows(between=",").replace("\n", ",\n"),
    "old line ends": rows().replace("\n", "\r"),
    "header": "x,y,z\n" + rows(between=","),
    "colours": "X,Y,Z,R,G,B\n" + rows(COLOURED, ","),
    "CloudCompare": "//X Y Z R G B\n" + rows(COLOURED),
    "CloudCompare with a count": "//X Y Z R G B\n40\n" + rows(COLOURED),
    "fewer names than columns": "//X Y Z\n" + rows(COLOURED),
    "normals": "x;y;z;nx\n" + rows(np.column_stack([POINTS, POINTS[:, 0]]), ";"),
    "other order": "z,y,x\n" + rows(POINTS[:, ::-1], ","),
    "order in a comment": "# z y x\n" + rows(POINTS[:, ::-1]),
    "prose in a comment": "# turned about z, y and x\n" + rows(),
    "Matlab": "% x y z\n" + rows(),
    "ParaView": '"Normals:0","Normals:1","Normals:2","Points:0","Points:1","Points:2"\n'
    + rows(np.column_stack([POINTS * 0, POINTS]), ","),
    "pandas": ",x,y,z\n" + counted(","),
    "pandas of an array": ",0,1,2\n" + counted(","),
    "pandas without an index": "0,1,2\n" + rows(between=","),
    "R": '"x" "y" "z"\n' + counted(" ", 1, '"'),
    "R without quotes": "x y z\n" + counted(" ", 1),
    "units": "X [m],Y [m],Z [m]\n" + rows(between=","),
    "text columns": "name,x,y,z\n" + counted(",").replace("\n", "\n2024-01-01 10:00:"),
    "ROS": "field.x,field.y,field.z\n" + rows(between=","),
    "Leica": "40\n" + rows(COLOURED),
    "two scans": "20\n" + rows(POINTS[:20]) + "20\n" + rows(POINTS[20:]),
    "mark": "\ufeff" + rows(),
    "mark and header": "\ufeffx,y,z\n" + rows(between=","),
    "decimal commas": "x;y;z\n" + rows(between=";").replace(".", ","),
    "decimal commas and tabs": rows(between="\t").replace(".", ","),
    "lists": str(POINTS.tolist()).replace("], ", "],\n"),
    "numpy": np.array2string(POINTS, threshold=1000),
    "quotes": rows(between='","').replace("\n", '"\n"')[:-1].join(['"', ""]),
    "Excel": "sep=;\nx;y;z\n" + rows(between=";"),
    "Fortran": rows(form="%.4e").replace("e", "D"),
}
TABLES["text columns"] = TABLES["text columns"].rpartition("\n")[0]


@pytest.mark.parametrize("text", TABLES.values(), ids=TABLES)
def test_tables_of_all_kinds_are_read(tmp_path: Path, text: str) -> None:
    np.testing.assert_allclose(read(tmp_path, text), POINTS, atol=1e-12)
    assert looks_like_table(tmp_path / "cloud.txt")


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".csv", ".tsv", ".pts", ".asc", ".TXT"])
def test_any_ending_may_hold_any_table(tmp_path: Path, suffix: str) -> None:
    np.testing.assert_allclose(read(tmp_path, "x;y;z\n" + rows(between=";"), suffix), POINTS)


def test_utf_16_is_read_by_its_mark_and_named_without_it(tmp_path: Path) -> None:
    text = "x,y,z\n" + rows(between=",")
    np.testing.assert_allclose(read(tmp_path, text, encoding="utf-16"), POINTS)
    assert "UTF-16 without its mark" in refusal(tmp_path, text, "utf-16-le")


@pytest.mark.parametrize("word", ["-nan(ind)", "1.#QNAN", "-1.#IND00", "nan", "NaN", "NA", "null", "nan(0x8000)"])
def test_what_programs_write_for_nan_is_nan(tmp_path: Path, word: str) -> None:
    text = rows(POINTS[:3]) + " ".join([word] * 3) + "\n" + rows(POINTS[3:])
    expected = np.insert(POINTS, 3, np.nan, axis=0)
    np.testing.assert_allclose(read(tmp_path, text), expected)


def test_empty_fields_are_nan_and_infinity_stays(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read(tmp_path, "1,2,3\n,,\n4,,6\n"), [[1, 2, 3], [np.nan] * 3, [4, np.nan, 6]])
    np.testing.assert_array_equal(read(tmp_path, "1 2 3\n1.#INF -1.#INF 0\n"), [[1, 2, 3], [np.inf, -np.inf, 0]])


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("x,y,z\n" + rows(between=",").replace(".", ","), "decimal commas need semicolons"),
        (rows(between=",").replace(".", ","), "commas between the columns and in the numbers"),
        ("x,y,intensity\n" + rows(between=","), "found no z among the columns"),
        ("x,y,z,x\n" + rows(np.column_stack([POINTS, POINTS[:, 0]]), ","), "named twice"),
        ("50\n" + rows(), "found 40 of the 50 points"),
        ("30\n" + rows(), "points that it declares"),
        (rows() + "1 2\n", "changed from 3 to 2 at row 40"),
        (rows() + "1 two 3\n", "'two' where a number is to be, at row 40, column 2"),
        ("x,y,z\n", "no row of three numbers, but 'x,y,z'"),
        ("<html>\n<body>", "HTML"),
        ("1 2\n3 4\n", "2 columns"),
        ("1 " * 100_000, "a line of more than 65,536 characters"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path: Path, text: str, found: str) -> None:
    assert found in refusal(tmp_path, text)


def test_a_header_of_other_names_leaves_the_first_columns_and_a_word_about_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "rearticulate.ingest"):
        np.testing.assert_allclose(read(tmp_path, "lon,lat,alt\n" + rows(between=",")), POINTS)
    assert "no x, y and z in the header 'lon,lat,alt'" in caplog.text


def test_reading_stops_at_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "cloud.txt"
    path.write_text(rows())
    assert len(read_points(path, 40)) == 40
    with pytest.raises(TooLargeError):
        read_points(path, 39)


def test_notes_are_no_table(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    for text in ("scanned on 3 May\nwith 2 cameras\n", "", "a,b,c\n", "\0" * 100):
        path.write_text(text)
        assert not looks_like_table(path)


OFF_ROWS = ["0.5 1.5 2.5", "1.5 2.5 3.5", "2.5 0.5 1.5", "3.5 1.5 0.5", "4.5 0.5 0.5", "5.5 0.5 0.5"]


@pytest.mark.parametrize(
    "lines",
    [
        ["OFF", "6 0 0", *OFF_ROWS],
        ["OFF", "# by a program", "6 1 0", *OFF_ROWS, "3 0 1 2"],
        ["6 0 0", *OFF_ROWS],
        ["6 4 12", *OFF_ROWS],
        ["COFF", "6 0 0", *(f"{row} 255 0 0 255" for row in OFF_ROWS)],
    ],
    ids=["off", "faces", "no word", "counts", "colours"],
)
def test_the_counts_of_an_off_file_are_no_point(tmp_path: Path, lines: list[str]) -> None:
    path = tmp_path / "cloud.txt"
    path.write_text("\n".join(lines) + "\n")
    np.testing.assert_array_equal(read_points(path), [list(map(float, row.split())) for row in OFF_ROWS])


@pytest.mark.parametrize("first", ["7 0 0", "0 0 0", "-6 0 0", "6.0 0 0"])
def test_a_first_row_of_whole_numbers_may_be_a_point(tmp_path: Path, first: str) -> None:
    path = tmp_path / "cloud.txt"
    path.write_text("\n".join([first, *OFF_ROWS]) + "\n")
    np.testing.assert_array_equal(read_points(path), [list(map(float, row.split())) for row in [first, *OFF_ROWS]])


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("OFF\n7 0 0\n" + "\n".join(OFF_ROWS), "found 6 of the 7 points"),
        ("1|2|3\n4|5|6\n", "put commas in place of the |"),
        ("[" + ", ".join(["[1.0, 2.0, 3.0]"] * 40) + "]\n", "found all points in one line"),
        ("[" + ", ".join(["[1.0, 2.0, 3.0]"] * 9000) + "]\n", "found all points in one line"),
        ("x,y,z\n", "'x,y,z'"),
        ("9" * 5000 + "\n" + "\n".join(OFF_ROWS), "found a count of '99999999999999999999', expected a number"),
        ("1,2 3\n4,5 6\n", "'1,2 3'"),
        ("# only a comment\n", "'# only a comment'"),
    ],
)
def test_why_a_folder_of_texts_holds_no_frames_is_said(tmp_path: Path, text: str, found: str) -> None:
    for index in range(2):
        (tmp_path / f"f{index}.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        read_frames(tmp_path)
    assert found in str(caught.value)
    assert "f0.csv: " in str(caught.value)


def test_points_of_several_triples_a_line_are_read(tmp_path: Path) -> None:
    path = tmp_path / "cloud.txt"
    path.write_text("[[1.5, 2, 3], [255, 0, 0]]\n" * 5)
    np.testing.assert_array_equal(read_points(path), [[1.5, 2, 3]] * 5)
