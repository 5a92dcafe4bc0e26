"""Folders of frames: their names and order, what else lies in them, and points that are no part of the thing."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from attacks.case import Case, Check, Maker, similar
from attacks.command import Ran
from attacks.hinge import Prepared, hinge, turn
from attacks.lists.makers import FIT, a_folder, a_pipe, both, file, found, given, link, moved, said


def named(names: Sequence[str], ending: str = ".npy") -> Maker:
    """Frames of these names, in this order of time."""

    def make(folder: Path, prepared: Prepared) -> None:
        (folder / "frames").mkdir()
        for name, points in zip(names, hinge(frames=len(names), points=200), strict=True):
            np.save(folder / "frames" / f"{name}{ending}", points)

    return make


def in_order(names: Sequence[str]) -> Check:
    """That the frames were taken in this order."""

    def check(folder: Path, ran: Ran) -> str:
        [manifest] = (folder / "out" / "workdir" / "scans").glob("*/ingest-*/manifest.json")
        taken = [name.removesuffix(".npy") for name in frame_names(json.loads(manifest.read_bytes())["payload"])]
        return "" if taken == list(names) else f"took them in the order {', '.join(taken)}"

    return check


def frame_names(payload: dict) -> list[str]:  # type: ignore[type-arg]
    return payload["sequence"]["frame_names"]  # type: ignore[no-any-return]


def order(name: str, names: Sequence[str]) -> Case:
    return Case(name, FIT, named(names), check=in_order(names))


def unclear(name: str, names: Sequence[str]) -> Case:
    """Names that can be read in another way: taken in this order, or the order is printed."""
    return Case(
        name, FIT, named(names), check=lambda folder, ran: said("order")(folder, ran) and in_order(names)(folder, ran)
    )


def points(
    name: str,
    change: Callable[[np.ndarray, int], np.ndarray],
    check: Check,
    frames: int = 4,
    number: int = 200,
    step: float = 0.3,
    command: str = FIT,
    may: tuple = ("refused", "accepted"),
) -> Case:  # type: ignore[type-arg]
    """Frames whose points are changed, by frame."""

    def make(folder: Path, prepared: Prepared) -> None:
        (folder / "frames").mkdir()
        for t, p in enumerate(hinge(frames=frames, points=number, step=step)):
            np.save(folder / "frames" / f"frame_{t}.npy", change(p, t))

    return Case(name, command, make, may=may, check=check)


def a_quarter(value: float) -> Callable[[np.ndarray, int], np.ndarray]:
    return lambda p, t: np.concatenate([p, np.full((len(p) // 3, 3), value)])


def listening(folder: Path, prepared: Prepared) -> None:
    before = Path.cwd()
    os.chdir(folder / "frames")  # a socket's path is short
    try:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind("frame_9.npy")
    finally:
        os.chdir(before)


def a_folder_each(folder: Path, prepared: Prepared) -> None:
    for t, p in enumerate(hinge(frames=4, points=200)):
        (folder / "frames" / f"{t:03d}").mkdir(parents=True)
        np.save(folder / "frames" / f"{t:03d}" / "cloud.npy", p)


def thousand(folder: Path, prepared: Prepared) -> None:
    np.save(folder / "frames.npy", np.stack(hinge(frames=1000, points=40, step=0.001)).astype("f4"))


CLOSED = "mov|still|nothing"
DROPPED = "identical|same|equal|duplicate|dropped"

CASES = [
    order("times as names", ["0.9", "1.05", "1.2", "10.1"]),
    order("negative numbers", ["-2", "-1", "1", "2"]),
    Case(
        "a folder for each frame", FIT, a_folder_each, may=("refused",), says="folder for each|each frame|sub-?folder"
    ),
    points("a quarter of the points at zero", a_quarter(0.0), said(DROPPED)),
    points("nothing moved", lambda p, t: p, said(CLOSED), step=0.0),
    points("millimetres without a unit", lambda p, t: 1000 * p, said("unit|metre|tonne|kg")),
    points(
        "millimetres that are said to be metres",
        lambda p, t: 1000 * p,
        said("unit|metre|tonne|kg"),
        command=f"{FIT} --units metre",
    ),
    Case(
        "a thousand frames",
        'timeout --preserve-status -s INT 8 reart fit frames.npy --out out --preset "$TINY"',
        thousand,
        says="ingest.every",
        exits=(130,),
    ),
    *[
        Case(
            f"units {unit}", f"{FIT} --units {unit}", given("frames"), may=("accepted",), check=found(6, diagonal=None)
        )
        for unit in ("mm", "m", "meters")
    ],
    *similar(
        order("times of the epoch", ["1700000000.25", "1700000000.5", "1700000001.0"]),
        unclear("numbers with exponents", ["1e-2", "1e-1", "1e0"]),
        unclear("numbers with signs and words", ["t-10", "t-2", "t+1", "t+12"]),
        order("dates", ["2024-01-31", "2024-02-01", "2024-10-01", "2024-11-30"]),
        unclear("dates with fractions", ["2024-01-31_12.59.59", "2024-01-31_13.00.00", "2024-01-31_13.10.00"]),
        unclear("versions", ["scan.1.9", "scan.1.10", "scan.1.11"]),
        unclear("names with capitals", ["Frame_1", "frame_2", "FRAME_3", "frame_10"]),
        order("numbers of 200 digits", ["1" * 200, "2" * 200, "1" + "0" * 200]),
        Case("digits that are no numbers", FIT, named(["frame_²", "frame_③", "frame_1", "frame_2"])),
        Case("arabic digits", FIT, named(["frame_\u0661", "frame_\u0662", "frame_\u0663"])),
        Case("names of markup", FIT, named(["[red]a", "[bold]b", "[link=x]c"])),
        Case("names with line breaks", FIT, named(["a\nb", "c\033[2J", "d\te"])),
        Case("names that look like options", FIT, named(["--out", "-1", "--help"])),
        Case(
            "a name of bytes",
            FIT,
            both(
                given("frames"),
                moved("frames/frame_0.npy", "frames/frame_\udcff.npy"),
            ),
        ),
        Case(
            "folders of markup",
            'reart fit "a[/red]" --out "out/o[/red]" --preset "$TINY"',
            both(given("frames"), a_folder("a["), moved("frames", "a[/red]")),
        ),
        Case("frames of two kinds", FIT, both(given("frames"), file("frames/a.xyz", "1 2 3\n" * 99)), may=("refused",)),
        Case(
            "a frame that is a folder",
            FIT,
            both(given("frames"), a_folder("frames/frame_9.npy")),
        ),
        Case(
            "a frame that is a pipe",
            FIT,
            both(given("frames"), a_pipe("frames/frame_9.npy")),
            seconds=60,
        ),
        Case("a frame that is a socket", FIT, both(given("frames"), listening)),
        Case("a frame that is a link to nothing", FIT, both(given("frames"), link("frames/frame_9.npy", "nowhere"))),
        Case("a frame that is a link to itself", FIT, both(given("frames"), link("frames/frame_9.npy", "frame_9.npy"))),
        Case(
            "a frame that is an endless device",
            FIT,
            both(given("frames"), link("frames/frame_9.npy", "/dev/zero")),
            seconds=30,
        ),
        Case(
            "a sequence that is a device",
            'reart fit /dev/zero --out out --preset "$TINY"',
            may=("refused",),
            seconds=30,
        ),
        Case(
            "a sequence that is a pipe",
            'mkfifo p.npy; reart fit p.npy --out out --preset "$TINY"',
            may=("refused",),
            seconds=30,
            writes=("p.npy",),
        ),
        Case("a sequence that is the root", 'reart fit / --out out --preset "$TINY"', may=("refused",), seconds=30),
        Case(
            "a sequence that is its own output",
            'reart fit frames --out frames --preset "$TINY"',
            given("frames"),
            writes=("frames",),
            check=lambda folder, ran: (
                "" if len(list((folder / "frames").glob("frame_*.npy"))) == 6 else "frames are gone"
            ),
        ),
        Case(
            "hidden files of a mounted drive",
            FIT,
            both(given("frames"), file("frames/._frame_0.npy", b"\0\5"), file("frames/Thumbs.db", b"x")),
            may=("accepted",),
        ),
        points("a quarter of the points at (7, 7, 7)", a_quarter(7.0), said(DROPPED)),
        points("a quarter of the points at -9999", a_quarter(-9999.0), said(DROPPED)),
        points(
            "a quarter of the points at zero, nearly",
            lambda p, t: np.concatenate([p, np.random.default_rng(t).normal(size=(len(p) // 3, 3)) * 1e-9]),
            said(DROPPED + "|near"),
        ),
        points("zeros in one frame only", lambda p, t: a_quarter(0.0)(p, t) if t == 1 else p, said(DROPPED)),
        points("every point twice", lambda p, t: np.concatenate([p, p]), found()),
        points("coordinates rounded to a tenth", lambda p, t: p.round(1), said(f"quanti|digits|resolution|{DROPPED}")),
        points("a part that is in one frame only", lambda p, t: p if t else p[: len(p) // 2], lambda folder, ran: ""),
        points(
            "two states 60 degrees apart", lambda p, t: p, found(2, diagonal=None), frames=2, number=800, step=np.pi / 3
        ),
        points(
            "frames of very different density", lambda p, t: p[:: (8, 1, 16)[t % 3]], found(3), frames=3, number=3200
        ),
        points("a mirrored frame", lambda p, t: p * [1, 1, -1 if t == 2 else 1], lambda folder, ran: ""),
        points(
            "one frame in millimetres",
            lambda p, t: p * (1000 if t == 2 else 1),
            lambda folder, ran: "",
            may=("refused",),
        ),
        points("an object that turns as a whole", lambda p, t: p @ turn(0.4 * t)[:3, :3], lambda folder, ran: ""),
        *[
            Case(f"units {unit!r}", f"{FIT} --units {unit!r}", given("frames"))
            for unit in ("MM", "inch", "", "furlong", "m²", "metre\n")
        ],
    ),
]
