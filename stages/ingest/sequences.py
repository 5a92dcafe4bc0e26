"""Detection of sequences among the files and folders of a data set, by names and headers."""

from __future__ import annotations

from pathlib import Path

from schemas.errors import InputError
from stages.ingest.depth_folder import is_depth_folder
from stages.ingest.listing import input_files, is_file, is_folder, is_own_output, left_out
from stages.ingest.point_formats import AMBIGUOUS_SUFFIXES, FRAME_SUFFIXES
from stages.ingest.readers import axes, clouds, frame_files

TRUTH_NAME = "ground_truth.npz"
FRAMES_NAME = "frames"


def is_sequence(path: Path, certainly: bool = False) -> bool:
    """Whether a path may be one sequence, or with `certainly` whether it certainly is one.

    Raises InputError, as all functions here, if the system does not allow the check.
    """
    if is_folder(path):
        if is_depth_folder(path):
            return True
        return holds_frames(path, certainly) or holds_frames(path / FRAMES_NAME) or _is_unfetched(path, certainly)
    if path.name == TRUTH_NAME or is_own_output(path) or not (is_file(path) or path.is_symlink()):
        return False
    return axes(path) in (0, 3)


def holds_frames(folder: Path, certainly: bool = False) -> bool:
    """Whether a folder holds frames. A single table may be anything; with `certainly`, several tables do not count."""
    files = frame_files(folder) if is_folder(folder) else []
    if files and files[0].suffix.lower() in AMBIGUOUS_SUFFIXES:
        return len(files) > 1 and not certainly
    kinds = {axes(file) for file in files}
    if kinds == {0}:
        return all(axes(file) != 3 for file in input_files(folder))
    return 2 in kinds


def _is_unfetched(folder: Path, certainly: bool) -> bool:
    """Whether a folder holds nothing but links to missing frames."""
    return not certainly and not input_files(folder) and bool(left_out(folder, FRAME_SUFFIXES, hidden=False))


def holds_many(path: Path) -> bool:
    """Whether a sequence's path holds more than one frame, if that can be listed."""
    try:
        return not is_folder(path) or is_depth_folder(path) or len(clouds(frame_files(path))) > 1
    except InputError:
        return False
