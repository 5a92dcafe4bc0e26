"""Frames as numpy's files: what people save, what they leave in, and what declares too much."""

from __future__ import annotations

import io
import json
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from attacks.case import Case, Check, Maker, similar
from attacks.hinge import Prepared, hinge
from attacks.lists.makers import (
    FIT,
    GIB,
    all_of,
    both,
    file,
    found,
    given,
    npy_head,
    npy_literal,
    said,
    sparse,
    zeros_in_zip,
)

NPZ, NPY = (f'reart fit {name} --out out --preset "$TINY"' for name in ("frames.npz", "frames.npy"))
HUGE = (2, 70_000_000, 3)  # 3.4 GB of float64


class Touch:
    """Pickled, it writes the file `victim` where it is loaded."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, str]]:
        return open, ("victim", "w")


def npz(
    name: str,
    arrays: Callable[[list[np.ndarray]], dict[str, Any]],
    must: bool = False,
    check: Check | None = None,
    says: str = "",
    may: tuple[str, ...] | None = None,
) -> Case:
    """An .npz of what `arrays` makes of four frames."""

    def make(folder: Path, prepared: Prepared) -> None:
        np.savez(folder / "frames.npz", **arrays(hinge(frames=4, points=200)))

    return Case(
        name,
        NPZ,
        make,
        may=may or (("accepted",) if must else ("refused", "accepted")),  # type: ignore[arg-type]
        check=check or found(),
        says=says,
    )


def npy(
    name: str,
    array: Callable[[np.ndarray], np.ndarray],
    may: tuple[str, ...] = ("refused",),
    says: str = "",
    check: Check | None = None,
) -> Case:
    """An .npy of what `array` makes of (4, 200, 3)."""

    def make(folder: Path, prepared: Prepared) -> None:
        np.save(folder / "frames.npy", array(np.stack(hinge(frames=4, points=200))), allow_pickle=True)

    return Case(name, NPY, make, may=may, says=says, check=check)  # type: ignore[arg-type]


def raw(name: str, content: bytes, may: tuple[str, ...] = ("refused",)) -> Case:
    """An .npy of these bytes."""
    return Case(name, NPY, file("frames.npy", content), may=may)  # type: ignore[arg-type]


def members(content: Callable[[np.ndarray], dict[str, bytes]], compression: int = zipfile.ZIP_DEFLATED) -> Maker:
    """An archive of any members."""

    def make(folder: Path, prepared: Prepared) -> None:
        with zipfile.ZipFile(folder / "frames.npz", "w", compression) as archive:
            for name, bytes_ in content(np.stack(hinge(frames=4, points=200))).items():
                archive.writestr(name, bytes_)

    return make


def saved(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def unequal(frames: list[np.ndarray]) -> list[np.ndarray]:
    return [points[: len(points) - 10 * t] for t, points in enumerate(frames)]


def objects(frames: list[np.ndarray]) -> np.ndarray:
    array = np.empty(len(frames), dtype=object)
    array[:] = unequal(frames)
    return array


def multibody(frames: list[np.ndarray]) -> dict[str, Any]:
    motions = np.empty(4, dtype=object)
    motions[:] = [{0: np.eye(4)}] * 4
    return {"pc": np.stack(frames).astype(np.float32), "segm": np.zeros((4, 200), dtype=int), "trans": motions}


def broken_zip(folder: Path, prepared: Prepared) -> None:
    members(lambda stack: {"points.npy": saved(stack)})(folder, prepared)
    content = (folder / "frames.npz").read_bytes()
    (folder / "frames.npz").write_bytes(content[: len(content) // 2])


def lying_directory(folder: Path, prepared: Prepared) -> None:
    """Its directory says that a member of 300 MB is of 5 kB."""
    content = npy_head((1, 12_500_000, 3)) + b"\0" * 300_000_000
    with zipfile.ZipFile(folder / "frames.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("points.npy", content)
    data = (folder / "frames.npz").read_bytes()
    (folder / "frames.npz").write_bytes(data.replace(len(content).to_bytes(4, "little"), (5000).to_bytes(4, "little")))


def zeros(names: dict[str, bytes], sound: bool = False, size: int = 3 * GIB) -> Maker:
    def make(folder: Path, prepared: Prepared) -> None:
        zeros_in_zip(folder / "frames.npz", names, size)
        if sound:
            with zipfile.ZipFile(folder / "frames.npz", "a") as archive:
                archive.writestr("points.npy", saved(np.stack(hinge(frames=4, points=200))))

    return make


def twice(folder: Path, prepared: Prepared) -> None:
    for mode in ("w", "a"):
        with zipfile.ZipFile(folder / "frames.npz", mode) as archive:  # type: ignore[call-overload]
            archive.writestr("points.npy", saved(np.stack(hinge(frames=4, points=200))))


def object_folder(folder: Path, prepared: Prepared) -> None:
    (folder / "frames").mkdir()
    for t in range(3):
        np.save(folder / "frames" / f"frame_{t}.npy", np.array([Touch()]), allow_pickle=True)


def geographic(frames: list[np.ndarray], dtype: str) -> dict[str, Any]:
    return {"points": (np.stack(frames) * 0.3 + [694386.212, 5155487.512, 381.036]).astype(dtype)}


def near(folder: Path, ran: object) -> str:
    """That a model at geographic coordinates keeps its digits, and its joint lies by its parts."""
    points = np.load(folder / "out" / "model.npz")["canonical_points"]
    truth = np.stack(hinge(frames=4, points=200)) * 0.3 + [694386.212, 5155487.512, 381.036]
    model = json.loads((folder / "out" / "model.json").read_bytes())
    off = np.abs(points.astype(np.float64) - truth[model["canonical_frame"]]).max()
    away = np.linalg.norm(np.array(model["joints"][0]["point"]) - truth.mean(axis=(0, 1)))
    wrong = [f"points are {off:.2g} off"] * bool(off > 1e-4) + [f"the joint is {away:.2g} away"] * bool(away > 2)
    return "; ".join(wrong)


CASES = [
    npz("savez of unequal frames", lambda f: {f"arr_{t}": points for t, points in enumerate(unequal(f))}, must=True),
    npz("keys frame_0 and so on", lambda f: {f"frame_{t}": points for t, points in enumerate(unequal(f))}, must=True),
    npz("pc_start and pc_end", lambda f: {"pc_start": f[0], "pc_end": f[2]}, must=True, check=found(2, parts=None)),
    npz("of MultiBodySync", multibody, must=True),
    npz("frames with colours", lambda f: {"points": np.concatenate([np.stack(f), 0 * np.stack(f)], axis=2)}, must=True),
    npz("geographic coordinates", lambda f: geographic(f, "f8"), must=True, check=all_of(found(diagonal=None), near)),
    npz(
        "geographic coordinates in single precision",
        lambda f: geographic(f, "f4"),
        check=said("quanti|digits|resolution|precision|grid"),
    ),
    npy("an array of objects", lambda stack: objects(list(stack)), says="one .npy"),
    npz("an array of objects in .npz", lambda f: {"points": objects(f)}, may=("refused",), says="one .npy"),
    Case(
        "two arrays of 3.4 GB",
        NPZ,
        zeros({"a.npy": npy_head(HUGE), "b.npy": npy_head(HUGE)}, size=10**9),
        may=("refused",),
    ),
    Case("points of 3 GiB", NPZ, zeros({"points.npy": npy_head((2, 67_000_000, 3))}), may=("refused",)),
    Case(
        "a member of 3 GiB that is not needed",
        NPZ,
        zeros({"video.npy": npy_head((3 * GIB,), "|u1")}, sound=True),
        may=("accepted",),
        check=found(),
    ),
    Case(
        "a member that is no array",
        NPZ,
        members(lambda stack: {"points.npy": saved(stack), "readme.txt": b"Hello"}),
        may=("accepted",),
        check=found(),
    ),
    *similar(
        Case("only a member that is no array", NPZ, members(lambda stack: {"readme.txt": b"Hello"}), may=("refused",)),
        Case("no members", NPZ, members(lambda stack: {}), may=("refused",)),
        Case("cut in the middle", NPZ, broken_zip, may=("refused",)),
        Case("a directory that lies", NPZ, lying_directory, may=("refused",), gib=1.5),
        Case("a member twice", NPZ, twice, check=found()),
        Case(
            "a member with a path upwards",
            NPZ,
            members(lambda stack: {"../../victim.npy": saved(stack)}),
            check=found(),
        ),
        Case(
            "compressed by lzma",
            NPZ,
            members(lambda stack: {"points.npy": saved(stack)}, zipfile.ZIP_LZMA),
            check=found(),
        ),
        Case(
            "compressed by bzip2",
            NPZ,
            members(lambda stack: {"points.npy": saved(stack)}, zipfile.ZIP_BZIP2),
            check=found(),
        ),
        Case(
            "an archive in an archive",
            NPZ,
            members(lambda stack: {"points.npz": b"PK\x05\x06" + b"\0" * 18}),
            may=("refused",),
        ),
        Case(
            "a member that would run code",
            NPZ,
            members(lambda stack: {"points.npy": saved(np.array([Touch()]))}),
            may=("refused",),
        ),
        Case("a bare pickle named .npy", NPY, file("frames.npy", pickle.dumps(Touch())), may=("refused",)),
        Case("frames that would run code", FIT, object_folder, may=("refused",), says="one .npy|plain|object"),
        npz("keys in another case", lambda f: {"Points": np.stack(f)}, check=found()),
        npz(
            "unequal frames with their labels",
            lambda f: {f"frame_{t}": p for t, p in enumerate(f)} | {"labels": np.zeros((4, 200), dtype=int)},
            check=found(),
        ),
        npz(
            "frames from 2 to 11",
            lambda f: {f"frame_{t}": p for t, p in zip((2, 11, 3, 10), [f[0], f[3], f[1], f[2]], strict=True)},
            check=found(),
        ),
        npz(
            "frames of which one is flat",
            lambda f: {f"arr_{t}": p if t else p[:, 0] for t, p in enumerate(f)},
            check=said("arr_0"),
        ),
        npz("frames with a scalar", lambda f: {"points": np.stack(f), "fps": np.array(30.0)}, must=True),
        npz("two stacks", lambda f: {"before": np.stack(f), "after": np.stack(f)}),
        npz("a hundred empty arrays", lambda f: {f"a{k}": np.empty((0, 3)) for k in range(100)}, may=("refused",)),
        npy(
            "frames with a mask",
            lambda s: np.concatenate([s, s[..., :1]], axis=2),
            may=("refused", "accepted"),
            check=found(),
        ),
        npy(
            "frames with normals and colours",
            lambda s: np.concatenate([s, s, s], axis=2),
            may=("refused", "accepted"),
            check=found(),
        ),
        npy("coordinates before points", lambda s: s.transpose(0, 2, 1)),
        npy("points before frames", lambda s: s.transpose(1, 0, 2), may=("refused",)),
        npy("four axes", lambda s: s[None]),
        npy("one frame", lambda s: s[0]),
        npy("a stack of one frame", lambda s: s[:1]),
        npy("no frames", lambda s: s[:0]),
        npy("no points", lambda s: s[:, :0]),
        npy("text", lambda s: s.astype("U8")),
        npy("complex numbers", lambda s: s.astype(complex)),
        npy("booleans", lambda s: s > 0),
        npy("dates", lambda s: s.astype("M8[s]")),
        npy(
            "a record of x, y, z",
            lambda s: s.view([("x", "f8"), ("y", "f8"), ("z", "f8")])[..., 0],
            may=("refused", "accepted"),
            check=found(),
        ),
        npy("half precision", lambda s: s.astype("f2"), may=("refused", "accepted"), check=found()),
        npy(
            "big-endian and Fortran's order",
            lambda s: np.asfortranarray(s.astype(">f8")),
            may=("accepted",),
            check=found(),
        ),
        npy(
            "whole numbers of millimetres",
            lambda s: (1000 * s).astype("i2"),
            may=("accepted",),
            check=found(diagonal=2200),
        ),
        npy("all NaN", lambda s: s * np.nan),
        npy("coordinates of 1e200", lambda s: s * 1e200),
        npy("coordinates of 1e-200", lambda s: s * 1e-200),
        npy("all points equal", lambda s: s * 0 + 3),
        npy("all points on a line", lambda s: s * [1, 0, 0], may=("refused", "accepted")),
        npy("all points in a plane", lambda s: s * [1, 1, 0], may=("refused", "accepted")),
        npy("the same frame four times", lambda s: s[[0, 0, 0, 0]], may=("accepted",), check=said("mov|still")),
        npy(
            "one point far away",
            lambda s: np.concatenate([s, 0 * s[:, :1] + 1e6], axis=1),
            may=("refused", "accepted"),
            check=said("far|stray|apart|outl"),
        ),
        raw("a header of NaN", npy_literal("{'descr': '<f8', 'fortran_order': False, 'shape': (nan, 3), }")),
        raw("a header that nests", npy_literal("(" * 5000)),
        raw(
            "a header of an expression",
            npy_literal("{'descr': '<f8', 'fortran_order': False, 'shape': (9**9**9, 3), }"),
        ),
        raw("a negative shape", npy_head((-2, 200, 3)) + bytes(9600)),
        raw("a shape beyond all numbers", npy_head((2**62, 2**62, 3)) + bytes(9600)),
        raw("a shape of zero by infinity", npy_head((0, 2**62, 3))),
        raw(
            "a data type that nests",
            npy_literal("{'descr': [('a', [('b', 'O')])], 'fortran_order': False, 'shape': (2,), }"),
        ),
        raw("the head of an array of 5 TB", npy_head((4, 50_000_000_000, 3)) + bytes(9600)),
        raw("a version of the future", b"\x93NUMPY\x09\x00" + bytes(200)),
        raw("nothing", b""),
        Case(
            "a sparse array of 3 GiB",
            NPY,
            sparse("frames.npy", npy_head((2, 67_000_000, 3)), 128 + 2 * 67_000_000 * 24),
            may=("refused",),
        ),
        Case(
            "a sparse frame of 3 GiB",
            FIT,
            both(given("frames"), sparse("frames/frame_9.npy", npy_head((134_000_000, 3)), 128 + 134_000_000 * 24)),
            may=("refused",),
        ),
    ),
]
