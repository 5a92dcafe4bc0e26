"""Targets and states for `reart pose`."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from attacks.case import Case, Verdict, similar
from attacks.lists.makers import Maker, both, file, given, npy_head, sparse, zeros_in_zip
from attacks.lists.models import alone

REFUSED: tuple[Verdict, ...] = ("refused",)
MODEL = both(given("model"), alone)
HEAD = "source_x,source_y,source_z,target_x,target_y,target_z\n"


def states(name: str, content: str | bytes, may: tuple[Verdict, ...] = REFUSED, ending: str = "json") -> Case:
    return Case(
        f"states: {name}",
        f"reart pose model --states s.{ending} --out out",
        both(MODEL, file(f"s.{ending}", content)),
        may=may,
        seconds=60,
    )


def targets(name: str, content: str | bytes | Maker, may: tuple[Verdict, ...] = REFUSED, ending: str = "csv") -> Case:
    make = file(f"t.{ending}", content) if isinstance(content, str | bytes) else content
    return Case(
        f"targets: {name}", f"reart pose model --targets t.{ending} --out out", both(MODEL, make), may=may, seconds=60
    )


def saved(**arrays: np.ndarray) -> bytes:
    kept = io.BytesIO()
    np.savez(kept, **arrays)  # type: ignore[arg-type]
    return kept.getvalue()


def bomb(folder: Path, prepared: object) -> None:
    zeros_in_zip(folder / "t.npz", {f"{name}.npy": npy_head((67_000_000, 3)) for name in ("source", "target")}, 10**9)


EITHER: tuple[Verdict, ...] = ("refused", "accepted")

CASES = similar(
    states("nested", '{"a": ' + "[" * 100_000 + "]" * 100_000 + "}"),
    states("a number of 400 digits", '{"joint_1_0": 1' + "0" * 400 + "}"),
    states("a number of 5000 digits", '{"joint_1_0": 1' + "0" * 5000 + "}"),
    states("1e999", '{"joint_1_0": 1e999}'),
    states("NaN", '{"joint_1_0": NaN}'),
    states("true", '{"joint_1_0": true}'),
    states("null", '{"joint_1_0": null}'),
    states("text", '{"joint_1_0": "1"}'),
    states("a joint twice", '{"joint_1_0": 0, "joint_1_0": 1}'),
    states("a joint that is not there", '{"[/red]": 0}'),
    states("half a character", '{"\\ud800": 0}'),
    states("a list", "[0, 1]"),
    states("nothing", ""),
    states("a pose of no model", '{"format": "rearticulate/pose", "version": 1}'),
    states("a format of another kind", '{"format": 3}'),
    states("csv with zero bytes", "name,value\njoint_1_0,\0\n", ending="csv"),
    states("csv with a cell of a megabyte", "name,value\n" + "x" * 10**6 + ",1\n", ending="csv"),
    states("csv of bytes", bytes(range(256)), ending="csv"),
    states("csv with an open quote", 'name,value\n"joint_1_0,1\n', ending="csv"),
    targets("NaN", f"{HEAD}nan,0,0,0,0,0\n"),
    targets("1e300", f"{HEAD}0,0,0,1e300,0,0\n"),
    targets("1e14", f"{HEAD}0,0,0,1e14,0,0\n", EITHER),
    targets("a number of 5000 digits", f"{HEAD}{'9' * 5000},0,0,0,0,0\n"),
    targets("only a header", HEAD),
    targets("a header in capitals", HEAD.upper() + "0,0,0,0,0,0\n", EITHER),
    targets("with semicolons", HEAD.replace(",", ";") + "0;0;0;0;0;0\n", EITHER),
    targets("a million pairs that are one", HEAD + "0,0,0,1,1,1\n" * 1_000_000, EITHER),
    targets("2 GiB of zeros", sparse("t.csv", HEAD.encode(), 2 * 2**30)),
    targets("json of 2 GiB of zeros", sparse("t.json", b"{", 2 * 2**30), ending="json"),
    targets("ragged json", '{"source": [[0, 0, 0], [1]], "target": [[0, 0, 0]]}', ending="json"),
    targets(
        "json with a number of 400 digits",
        '{"source": [[1' + "0" * 400 + ', 0, 0]], "target": [[0, 0, 0]]}',
        ending="json",
    ),
    targets("json with 64 axes", '{"source": ' + "[" * 70 + "]" * 70 + ', "target": [[0, 0, 0]]}', ending="json"),
    targets("npz of objects", saved(source=np.array([{}]), target=np.zeros((1, 3))), ending="npz"),
    targets("npz of complex numbers", saved(source=np.zeros((1, 3), complex), target=np.zeros((1, 3))), ending="npz"),
    targets("npz of 3 GB", bomb, ending="npz"),
    targets("a pipe", "", ending="txt"),
    Case(
        "targets: a named pipe",
        "mkfifo t.csv; reart pose model --targets t.csv",
        MODEL,
        may=REFUSED,
        seconds=30,
        writes=("t.csv",),
    ),
    Case("targets: a folder", "mkdir t.csv; reart pose model --targets t.csv", MODEL, may=REFUSED, writes=("t.csv",)),
    Case("scale: NaN", "reart export model --to urdf --out out --scale nan", MODEL, may=REFUSED),
    Case("scale: -1", "reart export model --to urdf --out out --scale=-1", MODEL, may=REFUSED),
    Case("scale: 1e-300", "reart export model --to urdf --out out --scale 1e-300", MODEL, may=REFUSED),
    Case("scale: 1e9", "reart export model --to mjcf --out out --scale 1e9", MODEL, may=EITHER),
    Case("scale: 1e-9", "reart export model --to mjcf --out out --scale 1e-9", MODEL, may=EITHER),
)
