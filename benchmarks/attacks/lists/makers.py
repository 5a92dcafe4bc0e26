"""What several lists make their files with, and look at afterwards."""

from __future__ import annotations

import json
import os
import re
import shutil
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from attacks.case import Check, Maker
from attacks.command import Ran
from attacks.hinge import Prepared, hinge

FIT = 'reart fit frames --out out --preset "$TINY"'
GIB = 2**30


def given(*names: str) -> Maker:
    """What is prepared."""
    return lambda folder, prepared: prepared.give(folder, *names)


def both(*makers: Maker) -> Maker:
    """One after the other."""

    def make(folder: Path, prepared: Prepared) -> None:
        for maker in makers:
            maker(folder, prepared)

    return make


def file(name: str, content: bytes | str) -> Maker:
    """One file."""

    def make(folder: Path, prepared: Prepared) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)

    return make


def sparse(name: str, head: bytes = b"", size: int = 3 * GIB) -> Maker:
    """A file that begins with `head` and goes on with zeros, which take no room."""

    def make(folder: Path, prepared: Prepared) -> None:
        file(name, head)(folder, prepared)
        os.truncate(folder / name, size)

    return make


def link(name: str, target: str) -> Maker:
    """A symbolic link; a target that begins with / is taken from the case's folder."""

    def make(folder: Path, prepared: Prepared) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(f"{folder}{target}" if target.startswith("/") and not target.startswith("/dev") else target)

    return make


def a_folder(name: str) -> Maker:
    """A folder, whatever was there before."""
    return both(gone(name), lambda place, prepared: (place / name).mkdir(parents=True))


def a_pipe(name: str) -> Maker:
    """A named pipe, in which nothing ever comes."""
    return both(gone(name), lambda place, prepared: os.mkfifo(place / name))


def gone(pattern: str) -> Maker:
    """What matches this is removed."""

    def make(place: Path, prepared: Prepared) -> None:
        for path in list(place.glob(pattern)):
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()

    return make


def moved(name: str, to: str) -> Maker:
    """A file or folder has another name; as the file system has it, which may be no text."""
    return lambda place, prepared: os.rename(place / name, place / to)


def each_frame(write: Callable[[Path, np.ndarray], None], ending: str, frames: int = 4, points: int = 200) -> Maker:
    """The folder `frames`, whose files `write` makes of the hinge's points."""

    def make(folder: Path, prepared: Prepared) -> None:
        (folder / "frames").mkdir()
        for t, points_of_frame in enumerate(hinge(frames=frames, points=points)):
            write(folder / "frames" / f"frame_{t}{ending}", points_of_frame)

    return make


def one_frame(name: str, content: bytes) -> Maker:
    """Prepared frames, and one more (or another) of this content."""
    return both(given("frames"), file(f"frames/{name}", content))


def found(frames: int = 4, parts: int | None = 2, diagonal: float | None = 2.2) -> Check:
    """That the fitted model has so many frames and parts and, within a tenth, such a diagonal of its points' box."""

    def check(folder: Path, ran: Ran) -> str:
        model = json.loads((folder / "out" / "model.json").read_bytes())
        if model["frames"] != frames or parts not in (None, len(model["parts"])):
            expected = f"{'any number' if parts is None else parts} in {frames}"
            return f"found {len(model['parts'])} parts in {model['frames']} frames, expected {expected}"
        points = np.load(folder / "out" / "model.npz")["canonical_points"].astype(np.float64)
        measured = float(np.linalg.norm(np.ptp(points, axis=0)))
        if diagonal is not None and not 0.9 < measured / diagonal < 1.1:
            return f"found points in a box with a diagonal of {measured:.4g}, expected about {diagonal}"
        return ""

    return check


def said(pattern: str) -> Check:
    """That an accepted input leads to a word."""
    return lambda folder, ran: (
        "" if re.search(pattern, " ".join(ran.words.split()), re.IGNORECASE) else f"does not say {pattern!r}"
    )


def all_of(*checks: Check) -> Check:
    return lambda folder, ran: "; ".join(filter(None, (check(folder, ran) for check in checks)))


def changed_json(path: str, change: Callable[[Any], Any]) -> Maker:
    """A prepared JSON file, changed: `change` changes what it is given, or returns another."""

    def make(folder: Path, prepared: Prepared) -> None:
        content = json.loads((folder / path).read_bytes())
        other = change(content)
        (folder / path).write_text(json.dumps(content if other is None else other))

    return make


def zeros_in_zip(path: Path, heads: Mapping[str, bytes], size: int) -> None:
    """An archive whose members begin with `heads` and go on with zeros up to `size` bytes each."""
    piece = b"\0" * 2**24
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, head in heads.items():
            with archive.open(name, "w", force_zip64=True) as member:
                member.write(head)
                for _ in range(max(0, size - len(head)) // len(piece)):
                    member.write(piece)


def npy_head(shape: tuple[int, ...], dtype: str = "<f8", fortran: bool = False) -> bytes:
    """The header of an .npy that declares this."""
    return npy_literal(f"{{'descr': '{dtype}', 'fortran_order': {fortran}, 'shape': {shape}, }}")


def npy_literal(text: str) -> bytes:
    """An .npy header of any text."""
    padded = text + " " * (-(len(text) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + len(padded).to_bytes(2, "little") + padded.encode("latin1")
