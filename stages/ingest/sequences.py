"""Which files and folders of a data set are sequences, by their names and headers."""

from __future__ import annotations

from pathlib import Path

from schemas.errors import InputError
from stages.ingest.listing import input_files, is_file, is_folder, is_own_output, left_out
from stages.ingest.point_formats import AMBIGUOUS_SUFFIXES, FRAME_SUFFIXES
from stages.ingest.readers import axes, clouds, frame_files

TRUTH_NAME = "ground_truth.npz"
FRAMES_NAME = "frames"


def is_sequence(path: Path, certainly: bool = False) -> bool:
    """Whether a path is one sequence, or may be one; `certainly` leaves out what may be something else.

    Raises InputError, as all here, where the system does not tell.
    """
    if is_folder(path):
        return holds_frames(path, certainly) or holds_frames(path / FRAMES_NAME) or _is_unfetched(path, certainly)
    if path.name == TRUTH_NAME or is_own_output(path) or not (is_file(path) or path.is_symlink()):
        return False
    return axes(path) in (0, 3)


def holds_frames(folder: Path, certainly: bool = False) -> bool:
    """Whether a folder holds frames; one table alone may be anything, and `certainly` not even several are frames."""
    files = frame_files(folder) if is_folder(folder) else []
    if files and files[0].suffix.lower() in AMBIGUOUS_SUFFIXES:
        return len(files) > 1 and not certainly
    kinds = {axes(file) for file in files}
    if kinds == {0}:
        return all(axes(file) != 3 for file in input_files(folder))
    return 2 in kinds


def _is_unfetched(folder: Path, certainly: bool) -> bool:
    """Whether a folder without other files holds links to frames that are not there."""
    return not certainly and not input_files(folder) and bool(left_out(folder, FRAME_SUFFIXES, hidden=False))


def holds_many(path: Path) -> bool:
    """Whether a sequence's path holds more than one frame, as far as that can be listed."""
    try:
        return not is_folder(path) or len(clouds(frame_files(path))) > 1
    except InputError:
        return False
