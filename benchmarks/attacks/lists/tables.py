"""Frames as text: what people export from scanners, spreadsheets and scripts."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from attacks.case import Case, Check, similar
from attacks.lists.makers import FIT, all_of, both, each_frame, file, found, given, one_frame, said, sparse

Line = Callable[[np.ndarray], str]


def text(
    name: str,
    line: Line = lambda p: " ".join(f"{value:.6f}" for value in p),
    ending: str = ".xyz",
    head: str | Callable[[int], str] = "",
    encoding: str = "utf-8",
    end: str = "\n",
    check: Check | None = None,
    must: bool = False,
) -> Case:
    """Frames of one line a point; `head` is what comes first, or makes it of the number of points."""

    def write(path: Path, points: np.ndarray) -> None:
        first = head if isinstance(head, str) else head(len(points))
        path.write_bytes((first + "".join(line(p) + end for p in points)).encode(encoding))

    may = ("accepted",) if must else ("refused", "accepted")
    return Case(name, FIT, each_frame(write, ending), may=may, check=check or found())


def joined(separator: str, more: str = "", form: str = "{:.6f}") -> Line:
    return lambda p: separator.join([*(form.format(value) for value in p), *more.split()])


def reversed_columns(p: np.ndarray) -> str:
    return ",".join(f"{value:.6f}" for value in (3 * p[2], 2 * p[1], p[0]))


def after_time(p: np.ndarray) -> str:
    return f"1700000000.5,{joined(',')(p)}"


def true_axis(direction: tuple[float, float, float]) -> Check:
    """That the columns were taken for what their header says: the hinge's axis lies where it should."""

    def check(folder: Path, ran: object) -> str:
        axis = json.loads((folder / "out" / "model.json").read_bytes())["joints"][0]["axis"]
        return "" if abs(np.dot(axis, direction)) > 0.9 else f"found an axis of {axis}, expected {direction}"

    return check


SOUND = "".join(f"{x} {y} {z}\n" for x, y, z in np.random.default_rng(0).uniform(size=(200, 3)).round(4))


def bad_cell(name: str, cell: str, ending: str = ".xyz", may_say: str = "", parts: int | None = 2) -> Case:
    """One point of each frame has this for a coordinate."""

    def write(path: Path, points: np.ndarray) -> None:
        lines = [joined(" ")(p) for p in points]
        lines[7] = f"{cell} 1.0 2.0"
        path.write_text("\n".join(lines) + "\n")

    return Case(
        name,
        FIT,
        each_frame(write, ending),
        check=all_of(found(parts=parts, diagonal=parts and 2.2), said(may_say or ".")),
    )


CASES = [
    text("csv with commas", joined(","), ".csv", must=True),
    text("csv with a header", joined(","), ".csv", "x,y,z\n", must=True),
    text("txt with semicolons", joined(";"), ".txt", must=True),
    text("txt with tabs", joined("\t"), ".txt", must=True),
    text("xyz of CloudCompare", joined(" ", "255 0 0"), ".xyz", "//X Y Z R G B\n", must=True),
    text("pts with a count", joined(" ", "-1200 90 80 70"), ".pts", lambda n: f"{n}\n", must=True),
    text("asc", joined(" "), ".asc", must=True),
    text("xyz with a byte order mark", joined(" "), encoding="utf-8-sig", must=True),
    text("xyz with normals", joined(" ", "0 0 1"), must=True),
    bad_cell("a cell of -nan(ind)", "-nan(ind)", may_say="dropped|NaN"),
    *similar(
        text("csv with quotes", joined(",", form='"{:.6f}"'), ".csv"),
        text("csv with commas at line ends", lambda p: joined(",")(p) + ",", ".csv"),
        text("csv with decimal commas", lambda p: joined(";")(p).replace(".", ","), ".csv"),
        text("txt with decimal commas and blanks", lambda p: joined(" ")(p).replace(".", ","), ".txt"),
        text(
            "csv with its columns in another order",
            lambda p: ",".join(f"{v:.6f}" for v in p[::-1]),
            ".csv",
            "z,y,x\n",
            check=all_of(found(), true_axis((0, 0, 1))),
        ),
        text("csv with the time first", after_time, ".csv", "time,x,y,z\n", check=found()),
        text("csv with named units", joined(","), ".csv", "x [m],y [m],z [m]\n"),
        text("csv in UTF-16", joined(","), ".csv", encoding="utf-16"),
        text("csv with the header's byte order mark", joined(","), ".csv", "x,y,z\n", encoding="utf-8-sig"),
        text("csv with carriage returns", joined(","), ".csv", end="\r\n"),
        text("csv with old carriage returns", joined(","), ".csv", end="\r"),
        text("txt with mixed separators", joined(", "), ".txt"),
        text("txt in capitals", joined(" "), ".TXT"),
        text("txt with many blanks in front", lambda p: "    " + joined("   ")(p), ".txt"),
        text("txt with two header lines", joined(" "), ".txt", "exported by a scanner\nX Y Z\n"),
        text("txt with a comment in latin-1", joined(" "), ".txt", "# Gerät 3\n", encoding="latin-1"),
        text("pts whose count is too high", joined(" "), ".pts", lambda n: f"{n + 300}\n", check=said("count|declare")),
        text("pts whose count is too low", joined(" "), ".pts", lambda n: f"{n // 2}\n", check=said("count|declare")),
        text("csv with a column of text", joined(",", "grass"), ".csv"),
        text("csv with an index and a header", lambda p: "1," + joined(",")(p), ".csv", "id,x,y,z\n", check=found()),
        text("xyz with exponents of Fortran", lambda p: joined(" ", form="{:.6e}")(p).replace("e", "D")),
        bad_cell("a cell of Microsoft's infinity", "1.#INF", may_say="dropped|infin|1.#INF"),
        bad_cell("a cell of Microsoft's NaN", "-1.#IND00", may_say="dropped|NaN|1.#IND"),
        bad_cell("a cell of 1e999", "1e999", may_say="dropped|infin"),
        bad_cell("a cell of a thousand digits", "9" * 1000),
        bad_cell("a cell of 1_0", "1_0", parts=None),
        bad_cell("a hexadecimal cell", "0x10"),
        bad_cell("a cell that is a formula", "=1+1"),
        bad_cell("a cell of markup", "[/red]"),
        Case("an empty csv", FIT, one_frame("frame_9.npy", b""), may=("refused",)),
        Case(
            "xyz of nothing but a header",
            FIT,
            each_frame(lambda path, p: path.write_text("x y z\n"), ".xyz"),
            may=("refused",),
        ),
        Case(
            "xyz of one column", FIT, each_frame(lambda path, p: path.write_text("1\n" * 200), ".xyz"), may=("refused",)
        ),
        Case(
            "xyz of two columns",
            FIT,
            each_frame(lambda path, p: path.write_text("1 2\n" * 200), ".xyz"),
            may=("refused",),
        ),
        Case(
            "xyz with a ragged line",
            FIT,
            each_frame(lambda path, p: path.write_text(SOUND + "1 2\n" + SOUND), ".xyz"),
            may=("refused",),
        ),
        Case(
            "xyz with zero bytes",
            FIT,
            each_frame(lambda path, p: path.write_bytes(b"1 2 3\0\n" * 99), ".xyz"),
            may=("refused",),
        ),
        Case(
            "xyz of random bytes",
            FIT,
            each_frame(lambda path, p: path.write_bytes(np.random.default_rng(0).bytes(4000)), ".xyz"),
            may=("refused",),
        ),
        Case(
            "csv of three GiB of zeros",
            FIT,
            both(*(sparse(f"frames/frame_{t}.csv", b"x,y,z\n1,2,3\n") for t in range(2))),
            may=("refused",),
        ),
        Case(
            "xyz of one line of 100 MB",
            FIT,
            each_frame(lambda path, p: path.write_text("1 " * 50_000_000), ".xyz", frames=2),
            may=("refused",),
        ),
        Case(
            "a table of figures, not of points",
            FIT,
            each_frame(lambda path, p: path.write_text("name,value\na,1\nb,2\n" * 40), ".csv"),
            may=("refused",),
        ),
        Case(
            "csv files that are a data set's",
            'reart run --dataset scans --data data --preset "$TINY" --workdir out',
            both(given("data"), file("data/notes.csv", "name,value\na,1\n")),
            may=("accepted",),
        ),
    ),
]
