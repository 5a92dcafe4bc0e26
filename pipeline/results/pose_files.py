"""The files of `reart pose`: it reads targets and joint states, and writes the pose and the posed points."""

from __future__ import annotations

import csv
import json
import reprlib
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64, UInt8
from pydantic import ValidationError

from pipeline.store.files import read_whole
from schemas.artifact import GREATEST
from schemas.errors import InputError, first_fault
from schemas.model_file import ModelFile
from schemas.pose import Pose, State
from stages.ingest.messages import one_line
from stages.ingest.readers import load_npz
from stages.kernels.labelling.colours import distinct_colours
from stages.kernels.points.precision import float32_holds

TARGET_COLUMNS = ("source_x", "source_y", "source_z", "target_x", "target_y", "target_z")
STATE_COLUMNS = ("name", "value")

Points = Float64[np.ndarray, "targets 3"]


def read_targets(path: Path) -> tuple[Points, Points]:
    """Read source points and their targets: .csv with TARGET_COLUMNS, .json or .npz with `source` and `target` (N, 3).

    Raises InputError for any other file, for an empty list of targets, and for values that are not finite.
    """
    source, target = _by_suffix(path, {".csv": _targets_of_csv, ".json": _targets_of_json, ".npz": _targets_of_npz})
    if len(source) != len(target) or not len(source):
        raise InputError(
            f"{path}: found {len(source)} source points and {len(target)} targets, expected pairs; add them"
        )
    if len(bad := np.flatnonzero(~np.isfinite(np.concatenate([source, target], axis=1)).all(axis=1))):
        raise InputError(f"{path}: row {bad[0] + 1}: found NaN or infinity, expected finite coordinates; leave it out")
    return source, target


def read_states(path: Path, model: ModelFile) -> tuple[dict[str, State], Float64[np.ndarray, "4 4"]]:
    """Read joint states by name and the root's motion: .csv with STATE_COLUMNS, .json {name: state}, or a pose.json.

    A state is one number, or several (in .csv separated by blanks). Only a pose.json can move the root. Raises
    InputError for any other file, and for a pose.json of another model or in other units than `model`.
    """
    return _by_suffix(path, {".csv": _states_of_csv, ".json": partial(_states_of_json, model=model)})


def pose_files(
    pose: Pose,
    p: Points,
    labels: Int64[np.ndarray, "points"],
    colours: UInt8[np.ndarray, "points 3"] | None = None,
) -> dict[str, bytes]:
    """The bytes of pose.json and posed.ply, whose points have the given colours, or those of their parts."""
    if colours is None:
        colours = (255 * distinct_colours(int(labels.max()) + 1)).round().astype(np.uint8)[labels]
    return {"pose.json": pose.model_dump_json(indent=1).encode() + b"\n", "posed.ply": _ply(p, labels, colours)}


def _by_suffix(path: Path, readers: Mapping[str, Callable[[Path], Any]]) -> Any:
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise InputError(f"{path}: found {suffix or 'no ending'}, expected {', '.join(readers)}; convert it")
    if not path.is_file():
        found = "found a folder" if path.is_dir() else "not found"
        raise InputError(f"{path}: {found}, expected a {suffix} file; check the path")
    return readers[suffix](path)


def _targets_of_csv(path: Path) -> tuple[Points, Points]:
    rows = _csv_rows(path, TARGET_COLUMNS)
    values = [[_number(cell, f"{path}: line {line}") for cell in cells] for line, cells in rows]
    table = np.array(values, dtype=np.float64).reshape(-1, 6)
    return table[:, :3], table[:, 3:]


def _targets_of_json(path: Path) -> tuple[Points, Points]:
    content = _json_object(path)
    return _positions(path, content, "source"), _positions(path, content, "target")


def _targets_of_npz(path: Path) -> tuple[Points, Points]:
    content = load_npz(path)
    return _positions(path, content, "source"), _positions(path, content, "target")


def _positions(path: Path, content: Mapping[str, Any], name: str) -> Points:
    """One of the two arrays of a file."""
    if name not in content:
        found = _name(", ".join(content)) or "neither"
        raise InputError(f"{path}: found {found}, expected source and target, each of shape (N, 3); name them so")
    expected = "expected numbers of shape (N, 3); correct it"
    try:
        array = np.asarray(content[name])
    except ValueError as error:
        raise InputError(f"{path}: {name}: found rows of different lengths, {expected}") from error
    if array.shape == (0,):
        array = array.reshape(0, 3)
    if array.dtype.kind not in "iuf" or array.ndim != 2 or array.shape[1] != 3:
        found = f"shape {array.shape}" if array.dtype.kind in "iuf" else "values that are no numbers"
        raise InputError(f"{path}: {name}: found {found}, {expected}")
    return array.astype(np.float64)


def _states_of_csv(path: Path) -> tuple[dict[str, State], Float64[np.ndarray, "4 4"]]:
    states: dict[str, State] = {}
    for line, (name, value) in _csv_rows(path, STATE_COLUMNS):
        where = f"{path}: line {line}"
        if name in states:
            raise InputError(f"{where}: found the joint {name[:80]!r} a second time, expected it once; remove one")
        states[name] = _state([_number(cell, where) for cell in value.split()], f"{where}: {_name(name)}")
    return states, np.eye(4)


def _states_of_json(path: Path, model: ModelFile) -> tuple[dict[str, State], Float64[np.ndarray, "4 4"]]:
    content = _json_object(path)
    if "format" in content:
        try:
            pose = Pose.model_validate_json(_text(path))
        except ValidationError as error:
            raise InputError(f"{path}: {first_fault(error)}; expected a pose of version 1, pose it anew") from error
        _check_origin(path, pose, model)
        return pose.states, np.array(pose.T_pose_root)
    values = {name: value if isinstance(value, list) else [value] for name, value in content.items()}
    return {name: _state(value, f"{path}: {_name(name)}") for name, value in values.items()}, np.eye(4)


def _check_origin(path: Path, pose: Pose, model: ModelFile) -> None:
    """Raise InputError for the pose of another model, since its joints only share their names."""
    remedy = "pose this model anew, or give the states alone, as {joint: state}"
    if pose.units != model.units:
        raise InputError(f"{path}: units: found {pose.units}, expected {model.units} as in the model; {remedy}")
    if pose.model_digest != model.digest:
        raise InputError(
            f"{path}: model_digest: found {_name(pose.model_digest)}, the pose of another model, "
            f"expected {model.digest}; {remedy}"
        )


def _state(values: list[Any], where: str) -> State:
    if len(values) not in (1, 3) or not all(type(value) in (int, float) for value in values):
        raise InputError(
            f"{where}: found {_brief(values)}, expected a number, or three of a rotation vector; correct it"
        )
    if not all(abs(value) <= GREATEST for value in values):
        raise InputError(f"{where}: found {_brief(values)}, expected finite numbers up to {GREATEST:g}; correct it")
    if len(values) == 1:
        return float(values[0])
    x, y, z = map(float, values)
    return x, y, z


def _csv_rows(path: Path, columns: tuple[str, ...]) -> list[tuple[int, list[str]]]:
    """The rows below the header, with their line numbers."""
    try:
        rows = list(enumerate(csv.reader(_text(path).splitlines()), start=1))
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read as CSV ({one_line(error)}); correct it") from error
    lines = [(line, cells) for line, cells in rows if any(cells)]
    header = [cell.strip() for cell in lines[0][1]] if lines else []
    if header != list(columns):
        found = ",".join(header)[:80]
        raise InputError(f"{path}: found the header {found!r}, expected {','.join(columns)!r}; put it first")
    for line, cells in lines[1:]:
        if len(cells) != len(columns):
            raise InputError(f"{path}: line {line}: found {len(cells)} values, expected {len(columns)}; correct it")
    return [(line, [cell.strip() for cell in cells]) for line, cells in lines[1:]]


def _number(text: str, where: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"{where}: found {text[:40]!r}, expected a number; correct it") from error


def _json_object(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(_text(path), object_pairs_hook=_without_doubles)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as JSON ({one_line(error)}); correct it") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: found {_brief(content)}, expected an object, {{name: ...}}; correct it")
    return content


def _brief(value: Any) -> str:
    """The beginning of a file's content, whatever its depth and length."""
    return reprlib.repr(value)[:40]


def _name(text: str) -> str:
    """Format a name from the user for a message."""
    return text[:80] if text.isprintable() else repr(text[:80])


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a JSON object. Raises ValueError for a repeated name."""
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f"found {name[:80]!r} a second time, expected it once")
        found[name] = value
    return found


def _text(path: Path) -> str:
    try:
        return read_whole(path).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text ({one_line(error)}); save it as UTF-8") from error


def _ply(p: Points, labels: Int64[np.ndarray, "points"], colours: UInt8[np.ndarray, "points 3"]) -> bytes:
    """Binary PLY with the part and the colour of each point."""
    kind = ("<f4", "float") if float32_holds(p) else ("<f8", "double")
    fields = [(axis, *kind) for axis in "xyz"]
    fields += [(colour, "u1", "uchar") for colour in ("red", "green", "blue")]
    fields += [("part", "<i4", "int")]
    records = np.zeros(len(p), dtype=[(name, dtype) for name, dtype, _ in fields])
    columns = np.concatenate([p, colours, labels[:, None]], axis=1)
    for (name, _, _), column in zip(fields, columns.T, strict=True):
        records[name] = column
    header = "".join(f"property {kind} {name}\n" for name, _, kind in fields)
    return (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(p)}\n{header}end_header\n".encode()
        + records.tobytes()
    )
