"""The files of the original RoboArt: state_K.pkl, pose_K.pkl and novel_pose_J.pkl of one sequence.

graph.gpickle and part_mapping.pkl beside them hold objects of other libraries and are not read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64

from schemas.errors import InputError
from stages.ingest.formats.arrays import as_points
from stages.ingest.listing import visible_files
from stages.ingest.messages import one_line
from stages.ingest.restricted_pickle import load_arrays

_STATE = re.compile(r"state_([0-9]+)\.pkl")
_NOVEL_POSE = re.compile(r"novel_pose_[0-9]+\.pkl")
_ANY = re.compile(r"(state|pose|novel_pose)_[0-9]+\.pkl")


def is_state(path: Path) -> bool:
    """Whether a file's name is that of a frame of the original RoboArt."""
    return _STATE.fullmatch(path.name) is not None


def pickles(folder: Path) -> list[Path]:
    """The files of a folder that belong to a sequence of the original RoboArt."""
    return [file for file in visible_files(folder) if _ANY.fullmatch(file.name)]


def has_transforms(folder: Path) -> bool:
    """Whether a folder holds the true transforms."""
    return any(not is_state(file) for file in pickles(folder))


def read_state_points(path: Path) -> Float64[np.ndarray, "points 3"]:
    """Read the points of one state_K.pkl. Raises InputError for any other content."""
    try:
        return as_points(_state_entry(path, "pc"))
    except ValueError as error:
        raise InputError(f"{path}: 'pc': {one_line(error)}; expected a state of the original RoboArt") from error


def read_transforms(
    folder: Path,
) -> tuple[
    list[Int64[np.ndarray, "points"]],
    Float64[np.ndarray, "frames parts 4 4"],
    Float64[np.ndarray, "states parts 4 4"],
    Int64[np.ndarray, "parts"],
]:
    """Read the labels of each frame, Ts_frame_first, Ts_novel_first, and the original part id of each label.

    pose_K.pkl maps part ids to the transforms from the first frame to frame K. That of the first frame may be missing.
    Raises InputError for a damaged or missing file and for a part without a transform.
    """
    states = [file for file in visible_files(folder) if is_state(file)]
    part_ids = [_read_part_ids(file) for file in states]
    ids = np.unique(np.concatenate(part_ids))
    Ts_frame_first = [
        np.tile(np.eye(4), (len(ids), 1, 1))
        if file is states[0] and not _pose_of(file).exists()
        else _read_poses(_pose_of(file), ids)
        for file in states
    ]
    Ts_novel_first = [_read_poses(file, ids) for file in visible_files(folder) if _NOVEL_POSE.fullmatch(file.name)]
    return (
        [np.searchsorted(ids, frame_ids) for frame_ids in part_ids],
        np.array(Ts_frame_first),
        np.array(Ts_novel_first).reshape(-1, len(ids), 4, 4),
        ids,
    )


def _pose_of(state: Path) -> Path:
    return state.with_name(_STATE.sub(r"pose_\1.pkl", state.name))


def _state_entry(path: Path, key: str) -> np.ndarray:
    state = load_arrays(path)
    array = state.get(key) if isinstance(state, dict) else None
    if not isinstance(array, np.ndarray):
        raise InputError(
            f"{path}: found no dict with an array '{key}', expected a state of the original RoboArt "
            "with 'pc' and 'part_id'; check that the file is whole"
        )
    return array


def _read_part_ids(path: Path) -> Int64[np.ndarray, "points"]:
    part_ids = _state_entry(path, "part_id")
    if part_ids.ndim != 1 or part_ids.dtype.kind not in "iu":
        raise InputError(
            f"{path}: 'part_id': found shape {part_ids.shape} of {part_ids.dtype}, "
            "expected one integer for each point; check that the file is whole"
        )
    return part_ids.astype(np.int64)


def _read_poses(path: Path, ids: Int64[np.ndarray, "parts"]) -> Float64[np.ndarray, "parts 4 4"]:
    poses = load_arrays(path)
    if not isinstance(poses, Mapping):
        raise InputError(f"{path}: found a {type(poses).__name__}, expected a dict of transforms by part; replace it")
    return np.array([_pose(poses, part_id, path) for part_id in ids.tolist()])


def _pose(poses: Mapping[Any, Any], part_id: int, path: Path) -> Float64[np.ndarray, "4 4"]:
    pose = poses.get(part_id)
    if not isinstance(pose, np.ndarray) or pose.shape != (4, 4) or pose.dtype.kind not in "fiu":
        raise InputError(f"{path}: found no 4 x 4 transform of part {part_id}, expected one for each part; replace it")
    return pose.astype(np.float64)
