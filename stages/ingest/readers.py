"""The frames of a sequence from the file or folder that holds them."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schemas.errors import InputError
from stages.ingest.listing import visible_files
from stages.ingest.point_formats import FRAME_SUFFIXES, Points, as_points, map_array, one_line, read_points
from stages.ingest.roboart_pickles import is_state, read_state_points

_STACK_KEYS = ("points", "pc")
_EXPECTED = "expected a folder of .ply, .pcd, .xyz or .npy frames, or one .npy or .npz of shape (frames, points, 3)"


@dataclass(frozen=True)
class Frame:
    """One point cloud as it was read: its file's name, and its points with NaN and infinity still in."""

    name: str
    points: Points


def read_frames(path: Path) -> list[Frame]:
    """The frames of one sequence, in natural order (frame_2 before frame_10), in the input's units.

    `path` is a folder with one file a frame (.ply, .pcd, .xyz, .npy, or the original RoboArt's state_K.pkl)
    or one .npy or .npz of shape (frames, points, 3). Raises InputError for a path that holds nothing of the
    kind, for a damaged file and for fewer than two frames.
    """
    if path.is_dir():
        frames = _read_folder(path)
    elif path.is_file():
        frames = _read_stack(path)
    else:
        raise InputError(f"{path}: found neither a file nor a folder there, {_EXPECTED}; check the path")
    if len(frames) < 2:
        raise InputError(f"{path}: found {len(frames)} frame, expected at least 2 of one moving object; add frames")
    return frames


def frame_files(folder: Path) -> list[Path]:
    """Those files of a folder that hold one frame each by their names, in natural order."""
    return [file for file in visible_files(folder) if _frame_kind(file) is not None]


def load_npz(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an .npz. Raises InputError where it is damaged or holds pickled objects."""
    try:
        with path.open("rb") as file:
            if not zipfile.is_zipfile(file):
                raise zipfile.BadZipFile("it is no zip archive")
            file.seek(0)
            with np.load(file, allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
    except Exception as error:  # zip, its compressors and numpy have many ways to say that a file is damaged
        raise InputError(
            f"{path}: cannot be read as .npz ({one_line(error)}), expected plain numeric arrays; save it with np.savez"
        ) from error


def _frame_kind(path: Path) -> str | None:
    if is_state(path):
        return "state_K.pkl"
    suffix = path.suffix.lower()
    return suffix if suffix in FRAME_SUFFIXES else None


def _read_folder(folder: Path) -> list[Frame]:
    files = frame_files(folder)
    if not files:
        others = [file.name for file in visible_files(folder)]
        more = ", ..." if len(others) > 3 else ""
        found = f"no frame among {', '.join(others[:3])}{more}" if others else "an empty folder"
        raise InputError(f"{folder}: found {found}, {_EXPECTED}; convert the files or check the path")
    kinds = sorted({str(_frame_kind(file)) for file in files})
    if len(kinds) > 1:
        raise InputError(
            f"{folder}: found frames of the kinds {' and '.join(kinds)}, expected one kind, "
            "since their order is unclear; move the others away"
        )
    return [Frame(file.name, (read_state_points if is_state(file) else read_points)(file)) for file in files]


def _read_stack(path: Path) -> list[Frame]:
    suffix = path.suffix.lower()
    if suffix == ".npy":
        stack = _load_npy(path)
    elif suffix == ".npz":
        stack = _pick_array(path, load_npz(path))
    elif suffix in FRAME_SUFFIXES:
        raise InputError(f"{path}: found one {suffix} file, which is one frame; give the folder that holds all frames")
    else:
        raise InputError(f"{path}: found a {suffix or 'nameless'} file, {_EXPECTED}; convert it")
    if stack.ndim != 3 or stack.shape[2] != 3:
        raise InputError(
            f"{path}: found an array of shape {stack.shape}, expected (frames, points, 3); "
            "save one array with all frames, or a folder with one .npy of shape (points, 3) each"
        )
    return [Frame(f"{path.name}[{index}]", _as_frame(points, str(path))) for index, points in enumerate(stack)]


def _as_frame(array: np.ndarray, where: str) -> Points:
    try:
        return as_points(array)
    except ValueError as error:
        raise InputError(f"{where}: {one_line(error)}; save the coordinates as floats of shape (points, 3)") from error


def _load_npy(path: Path) -> np.ndarray:
    try:
        return map_array(path)
    except (ValueError, OSError) as error:
        raise InputError(
            f"{path}: cannot be read as .npy ({one_line(error)}), expected plain numbers; save it with np.save"
        ) from error


def _pick_array(path: Path, arrays: dict[str, np.ndarray]) -> np.ndarray:
    named = [name for name in _STACK_KEYS if name in arrays]
    if not named and len(arrays) != 1:
        raise InputError(
            f"{path}: found the arrays {', '.join(arrays) or '(none)'}, expected one, or one named 'points'; rename it"
        )
    return arrays[(named or list(arrays))[0]]
