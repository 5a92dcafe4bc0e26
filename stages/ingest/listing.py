"""The files of a folder, in natural order."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

from schemas.errors import InputError
from stages.ingest.messages import unreadable
from stages.ingest.order import Key, natural_key

_OWN_OUTPUT = {"model.npz": "model.json", "posed.ply": "pose.json"}  # our output -> the file beside it
_HIDDEN = "hidden"


def natural_order(path: Path) -> tuple[Key, str]:
    """The sort key of natural order, which puts frame_2 before frame_10."""
    return natural_key(path.name)


def is_file(path: Path) -> bool:
    """Whether a path is a file. Raises InputError if the system does not allow the check."""
    try:
        return path.is_file()
    except OSError as error:
        raise unreadable(path, error) from error


def is_folder(path: Path) -> bool:
    """Whether a path is a folder. Raises as `is_file` does."""
    try:
        return path.is_dir()
    except OSError as error:
        raise unreadable(path, error) from error


def visible_files(folder: Path) -> list[Path]:
    """The files of a folder in natural order, without hidden ones. Raises InputError if it cannot be listed."""
    return [entry for entry in visible_entries(folder) if is_file(entry)]


def input_files(folder: Path) -> list[Path]:
    """The `visible_files` of a folder that may be input: without models and posed points that we wrote."""
    return [file for file in visible_files(folder) if not is_own_output(file)]


def is_own_output(file: Path) -> bool:
    """Whether a file is a model's arrays or the points of a pose."""
    return file.name in _OWN_OUTPUT and is_file(file.with_name(_OWN_OUTPUT[file.name]))


def visible_folders(folder: Path) -> list[Path]:
    """The folders in a folder, without hidden ones. Raises as `visible_files` does."""
    return [entry for entry in visible_entries(folder) if is_folder(entry)]


def visible_entries(folder: Path) -> list[Path]:
    """The files and folders of a folder in natural order, without hidden ones. Raises as `visible_files` does."""
    return [entry for entry in _entries(folder) if not entry.name.startswith(".")]


def left_out(folder: Path, suffixes: Collection[str], hidden: bool = True) -> list[str]:
    """The entries with one of these suffixes that `visible_files` leaves out, each with the reason."""
    reasons = {entry: _why_left_out(entry) for entry in _entries(folder) if entry.suffix.lower() in suffixes}
    return [f"{entry.name} ({why})" for entry, why in reasons.items() if why and (hidden or why != _HIDDEN)]


def _why_left_out(entry: Path) -> str:
    """Why an entry is not a visible file. Empty for one that is, for folders, and for macOS's own files."""
    if is_folder(entry) or entry.name.startswith("._"):
        return ""
    if not is_file(entry):
        return "a link to nothing" if entry.is_symlink() else "no plain file"
    return _HIDDEN if entry.name.startswith(".") else ""


def safe_name(name: str) -> str:
    """Replace all but letters, digits, dots, dashes and underscores, for folders and command lines."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._-") or "sequence"


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir(), key=natural_order)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be listed ({error.strerror}); check the path") from error
