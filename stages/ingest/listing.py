"""The files of a folder, in the order in which people number them."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

from schemas.errors import InputError
from stages.ingest.messages import unreadable
from stages.ingest.order import Key, natural_key

_OWN_OUTPUT = {"model.npz": "model.json", "posed.ply": "pose.json"}  # and what is written beside it
_HIDDEN = "hidden"


def natural_order(path: Path) -> tuple[Key, str]:
    """A sort key that puts frame_2 before frame_10."""
    return natural_key(path.name)


def is_file(path: Path) -> bool:
    """Whether a file is there. Raises InputError where the system does not tell."""
    try:
        return path.is_file()
    except OSError as error:
        raise unreadable(path, error) from error


def is_folder(path: Path) -> bool:
    """Whether a folder is there, as `is_file`."""
    try:
        return path.is_dir()
    except OSError as error:
        raise unreadable(path, error) from error


def visible_files(folder: Path) -> list[Path]:
    """The files of a folder in natural order, without hidden ones. Raises InputError where it cannot be listed."""
    return [entry for entry in visible_entries(folder) if is_file(entry)]


def input_files(folder: Path) -> list[Path]:
    """The files of a folder that may be input, as `visible_files`: without a model and posed points that we wrote."""
    return [file for file in visible_files(folder) if not is_own_output(file)]


def is_own_output(file: Path) -> bool:
    """Whether a file is a model's arrays or the points of a pose."""
    return file.name in _OWN_OUTPUT and is_file(file.with_name(_OWN_OUTPUT[file.name]))


def visible_folders(folder: Path) -> list[Path]:
    """The folders in a folder, as `visible_files`."""
    return [entry for entry in visible_entries(folder) if is_folder(entry)]


def visible_entries(folder: Path) -> list[Path]:
    """The files and folders of a folder in natural order, without hidden ones, as `visible_files`."""
    return [entry for entry in _entries(folder) if not entry.name.startswith(".")]


def left_out(folder: Path, suffixes: Collection[str], hidden: bool = True) -> list[str]:
    """The entries with one of these endings that `visible_files` leaves out, each with the reason."""
    reasons = {entry: _why_left_out(entry) for entry in _entries(folder) if entry.suffix.lower() in suffixes}
    return [f"{entry.name} ({why})" for entry, why in reasons.items() if why and (hidden or why != _HIDDEN)]


def _why_left_out(entry: Path) -> str:
    """Why an entry is no visible file; empty for one that is, a folder, and what macOS writes beside files."""
    if is_folder(entry) or entry.name.startswith("._"):
        return ""
    if not is_file(entry):
        return "a link to nothing" if entry.is_symlink() else "no plain file"
    return _HIDDEN if entry.name.startswith(".") else ""


def safe_name(name: str) -> str:
    """A name of letters, digits, dots, dashes and underscores, for folders and command lines."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._-") or "sequence"


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir(), key=natural_order)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be listed ({error.strerror}); check the path") from error
