"""The files of a folder, in the order in which people number them."""

from __future__ import annotations

from pathlib import Path

from schemas.errors import InputError
from stages.ingest.messages import unreadable
from stages.ingest.order import Key, natural_key


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


def visible_folders(folder: Path) -> list[Path]:
    """The folders in a folder, as `visible_files`."""
    return [entry for entry in visible_entries(folder) if is_folder(entry)]


def visible_entries(folder: Path) -> list[Path]:
    """The files and folders of a folder in natural order, without hidden ones, as `visible_files`."""
    try:
        return sorted((entry for entry in folder.iterdir() if not entry.name.startswith(".")), key=natural_order)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be listed ({error.strerror}); check the path") from error
