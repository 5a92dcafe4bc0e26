"""Reading of a sequence's frames from a file or folder."""

from __future__ import annotations

import logging
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from schemas.errors import InputError
from stages.ingest.formats.arrays import PER_FRAME, as_points, load_npz, map_array, npy_header, points_shape
from stages.ingest.formats.cloud import Cloud, Colours, Points
from stages.ingest.formats.disguises import disguise
from stages.ingest.formats.mesh_pieces import MeshSampling
from stages.ingest.formats.meshes import MESH_SUFFIXES, names_materials
from stages.ingest.formats.npz_frames import find_frames, holds_one_cloud, read_npz_frames
from stages.ingest.formats.tables import looks_like_table
from stages.ingest.listing import input_files, is_file, is_folder, left_out, visible_folders
from stages.ingest.messages import TooLargeError, check_count, one_line, out_of_memory, too_large, unreadable
from stages.ingest.order import in_order
from stages.ingest.point_formats import AMBIGUOUS_SUFFIXES, FRAME_SUFFIXES, read_cloud
from stages.ingest.roboart_pickles import is_state, read_state_points

__all__ = ["Frame", "declared_frames", "frame_files", "load_npz", "read_frames"]

_log = logging.getLogger("rearticulate.ingest")

_CERTAIN_SUFFIXES = tuple(suffix for suffix in FRAME_SUFFIXES if suffix not in (*AMBIGUOUS_SUFFIXES, *MESH_SUFFIXES))
_OF_POINTS = re.compile(  # names of files with other values of a cloud's points
    r"(point_?|vertex_?)?(colou?rs?|rgba?|normals?|labels?|masks?|segm?s?|segmentations?|intensit(y|ies)|features?|ids?)",
    re.IGNORECASE,
)
_LOOKED_INTO = 50  # sub-folders to look into if a folder holds no frames
_EXPECTED = (
    "expected a folder of .ply, .pcd, .xyz, .txt, .csv, .pts, .npy, .obj, .stl, .glb, .e57 or .las frames, "
    "or one .npy or .npz of shape (frames, points, 3)"
)


@dataclass(frozen=True)
class Frame:
    """One point cloud as read: its file's name, its points, including NaN and infinity, and where cameras stood.

    All in the input's coordinates and units. Unknown viewpoints and colours are None.
    """

    name: str
    points: Points
    viewpoints: Float64[np.ndarray, "cameras 3"] | None = None
    colours: Colours | None = None


def read_frames(
    path: Path, every: int = 1, max_points: int = sys.maxsize, sampling: MeshSampling | None = None
) -> list[Frame]:
    """Read every `every`-th frame of one sequence, in the order of the numbers in their names, in the input's units.

    `path` is a folder with one file per frame (.ply, .pcd, a table of text, .npy, a mesh, or the original RoboArt's
    state_K.pkl), or one .npy or .npz with all frames. The surface of meshes is sampled if there is a `sampling`; else
    their vertices are taken. Raises InputError for a path that holds nothing of the kind, for a damaged file, for fewer
    than two frames, and for more points than `max_points`. If a file declares its number of points, that is checked
    before they are read.
    """
    if is_folder(path):
        return _read_folder(path, every, max_points, sampling)
    if is_file(path):
        return _read_stack(path, every, max_points)
    raise InputError(f"{path}: found neither a file nor a folder there, {_EXPECTED}; check the path")


def frame_files(folder: Path) -> list[Path]:
    """The files of a folder that hold one frame each, in order.

    Meshes (.obj, .stl, .glb, .gltf) are frames if there are no files of points. Files that may hold something else
    (.txt, .csv, .npz, ...) are frames if they look like it and there are no others.
    """
    files = input_files(folder)
    certain = [file for file in files if is_state(file) or file.suffix.lower() in _CERTAIN_SUFFIXES]
    meshes = [file for file in files if file.suffix.lower() in MESH_SUFFIXES]
    found = certain or meshes or [file for file in files if _looks_like_frame(file)]
    by_name = {file.name: file for file in found}
    return [by_name[name] for name in in_order(list(by_name)).names]


def declared_frames(path: Path) -> int | None:
    """How many frames a folder or a file holds by names and headers; None where these do not tell."""
    if is_folder(path):
        return len(frame_files(path))
    try:
        match path.suffix.lower():
            case ".npz":
                return find_frames(path).count
            case ".npy":
                shape, _ = npy_header(path)
                return shape[0] if len(shape) == 3 else None
    except (InputError, TooLargeError, ValueError, OSError):
        return None  # reading it reports the error
    return None


def clouds(files: list[Path]) -> list[Path]:
    """The files, except those whose names say that they hold the colours or the like of another file."""
    return [file for file in files if not _OF_POINTS.fullmatch(file.stem)] or files


def axes(path: Path) -> int:
    """The number of axes: 2 for a file of one frame, 3 for one that may hold a whole sequence, by kind or header.

    It is 0 for a .npy with an unreadable header. The other files of the folder then decide.
    """
    match path.suffix.lower():
        case ".npz":
            return 2 if holds_one_cloud(path) else 3
        case ".npy":
            try:
                shape, dtype = npy_header(path)
                return len(points_shape(shape, dtype)) or len(shape)
            except (ValueError, OSError):
                return 0
    return 2


def check_every(count: int, step: int) -> None:
    """Raise InputError if every `step`-th of `count` frames leaves only one."""
    if count >= 2 and step >= count:
        raise InputError(
            f"ingest.every: found {step}, which leaves one frame of {count}, expected two; give at most {count - 1}"
        )


def _looks_like_frame(file: Path) -> bool:
    suffix = file.suffix.lower()
    if suffix not in AMBIGUOUS_SUFFIXES:
        return False
    try:
        file.open("rb").close()
        return holds_one_cloud(file) if suffix == ".npz" else looks_like_table(file)
    except OSError:
        return True  # reading it as a frame reports the error


def _read_folder(folder: Path, every: int, max_points: int, sampling: MeshSampling | None) -> list[Frame]:
    files = frame_files(folder)
    if not files:
        raise InputError(f"{folder}: {_without_frames(folder)}")
    kinds = sorted({"state_K.pkl" if is_state(file) else file.suffix.lower() for file in files})
    if len(kinds) > 1:
        raise InputError(
            f"{folder}: found frames of the kinds {' and '.join(kinds)}, expected one kind, "
            "since their order is unclear; move the others away"
        )
    check_frame_count(folder, len(files), every)
    organised = _are_organised(files)
    _report(folder, files, organised)
    frames, left = [], max_points
    for file in files[::every]:
        try:
            cloud = Cloud(read_state_points(file)) if is_state(file) else read_cloud(file, left, organised, sampling)
            check_count(len(cloud.points), left)
        except TooLargeError as error:
            raise too_large(file, error, max_points) from error
        left -= len(cloud.points)
        frames.append(Frame(file.name, cloud.points, colours=cloud.colours))
    return frames


def _are_organised(files: list[Path]) -> bool:
    """Whether numbered .npy files of one shape each hold the rows and columns of one frame."""
    if in_order([file.name for file in files]).doubt or any(axes(file) != 3 for file in files):
        return False
    return len({npy_header(file)[0] for file in files}) == 1


def _report(folder: Path, files: list[Path], organised: bool) -> None:
    """Warn of doubts about the frames of a folder."""
    order = in_order([file.name for file in files])
    if order.doubt:
        _log.warning("%s: %s", folder, order.message())
    kind = files[0].suffix.lower()
    others = [file.name for file in input_files(folder) if file not in files and file.suffix.lower() == kind]
    if others and kind in AMBIGUOUS_SUFFIXES:
        _log.warning("%s: %s hold no points and are left out", folder, _first(others))
    if missing := left_out(folder, (kind,)):
        _log.warning("%s: left out %s", folder, _first(missing))
    if kind == ".obj" and names_materials(files[0]):
        _log.warning("%s: materials and pictures of .obj lie in other files and are not read; .glb keeps them", folder)
    if organised:
        _log.warning(
            "%s: took each .npy for the rows and columns of one frame; "
            "where each is a whole sequence, give the folder to `reart run --data`",
            folder,
        )


def _first(names: list[str]) -> str:
    """At most three names in one line."""
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")


def _without_frames(folder: Path) -> str:
    """Explain why a folder has no frames."""
    others = [file.name for file in input_files(folder)]
    if folders := frame_folders(folder):
        return folders
    nested = _frames_below(folder)
    if sequences := [below.name for below, files in nested if len(clouds(files)) > 1]:
        return (
            f"found no frames, but folders with frames ({', '.join(sequences[:3])}), expected one of them; "
            "give that, or all of them to `reart run --data`"
        )
    if missing := left_out(folder, FRAME_SUFFIXES):
        return f"found no frames but {_first(missing)}, {_EXPECTED}; fetch or rename the files"
    odd = next((file for file in input_files(folder) if file.suffix.lower() in AMBIGUOUS_SUFFIXES), None)
    if odd is not None:
        return f"found no frame among {_first(others)}, {_EXPECTED}; {odd.name}: {_why_no_frame(odd)}"
    found = f"no frame among {_first(others)}" if others else "an empty folder"
    if not others and nested:
        found = f"only folders without frames ({', '.join(below.name for below, _ in nested[:3])})"
    return f"found {found}, {_EXPECTED}; convert the files or check the path"


def _why_no_frame(file: Path) -> str:
    """Explain why a file that may be meant as a frame is none."""
    try:
        read_cloud(file)
    except InputError as error:
        return str(error).removeprefix(f"{file}: ")
    return "found no points"


def frame_folders(folder: Path) -> str:
    """Explain the problem of a folder whose sub-folders hold one frame each; empty for any other."""
    nested = [clouds(files) for _, files in _frames_below(folder) if files and axes(files[0]) == 2]
    if len(nested) < 2 or any(len(files) > 1 for files in nested):
        return ""
    first, second = (files[0] for files in nested[:2])
    return (
        f"found a folder for each frame ({first.parent.name}/{first.name}, {second.parent.name}/{second.name}, ...), "
        "expected all frames side by side in one folder; move them there and name them by their folders "
        f"({first.parent.name}{first.suffix}, {second.parent.name}{second.suffix}, ...)"
    )


def _frames_below(folder: Path) -> list[tuple[Path, list[Path]]]:
    """The first sub-folders that can be listed, with the frames in each."""
    found = []
    for below in visible_folders(folder)[:_LOOKED_INTO]:
        with suppress(InputError):
            found.append((below, frame_files(below)))
    return found


def _read_stack(path: Path, every: int, max_points: int) -> list[Frame]:
    suffix = path.suffix.lower()
    if suffix not in (".npy", ".npz"):
        if suffix in FRAME_SUFFIXES:
            raise InputError(
                f"{path}: found one {suffix} file, which is one frame; give the folder that holds all frames"
            )
        raise InputError(f"{path}: found a {suffix or 'nameless'} file, {_EXPECTED}; convert it")
    try:
        if suffix == ".npy":
            return [Frame(name, points) for name, points in _npy_frames(path, every, max_points)]
        frames = find_frames(path)
        check_frame_count(path, frames.count, every)
        if frames.doubt:
            _log.warning("%s: %s", path, frames.doubt)
        return [Frame(name, points) for name, points in read_npz_frames(path, frames, every, max_points)]
    except TooLargeError as error:
        raise too_large(path, error, max_points) from error
    except MemoryError as error:
        raise out_of_memory(path) from error


def _npy_frames(path: Path, every: int, most: int) -> Iterator[tuple[str, Points]]:
    try:
        stack = map_array(path)
    except OSError as error:
        raise unreadable(path, error) from error
    except ValueError as error:
        if found := disguise(path):
            raise InputError(f"{path}: {found}") from error
        raise InputError(
            f"{path}: cannot be read as .npy ({one_line(error)}), expected plain numbers; save it with np.save"
        ) from error
    shape = points_shape(stack.shape, stack.dtype)
    if len(shape) != 3:
        transposed = stack.ndim == 3 and stack.shape[1] == 3
        remedy = (
            "save the transpose, array.transpose(0, 2, 1)" if transposed else f"save such an array, or {PER_FRAME[5:]}"
        )
        raise InputError(
            f"{path}: found an array of shape {stack.shape} of {stack.dtype}, expected (frames, points, 3) "
            f"of real numbers; {remedy}"
        )
    check_frame_count(path, shape[0], every)
    check_count(shape[1] * len(range(0, shape[0], every)), most)
    for index in range(0, shape[0], every):
        yield f"{path.name}[{index}]", as_points(np.asarray(stack[index]))


def check_frame_count(path: Path, count: int, every: int) -> None:
    """Raise InputError for fewer than two frames, and for `every` that leaves only one."""
    if count < 2:
        found = "1 frame" if count else "no frame"
        raise InputError(f"{path}: found {found}, expected at least 2 of one moving object; add frames")
    check_every(count, every)
