"""The files of a folder, in the order in which people number them."""

from __future__ import annotations

import re
from pathlib import Path

from schemas.errors import InputError


def natural_order(path: Path) -> tuple[list[str | int], str]:
    """A sort key that puts frame_2 before frame_10."""
    pieces = re.split(r"([0-9]+)", path.name)  # text and digits take turns, so that like meets like
    return [int(piece) if index % 2 else piece for index, piece in enumerate(pieces)], path.name


def visible_files(folder: Path) -> list[Path]:
    """The files of a folder in natural order, without hidden ones. Raises InputError where it cannot be listed."""
    return [entry for entry in visible_entries(folder) if entry.is_file()]


def visible_folders(folder: Path) -> list[Path]:
    """The folders in a folder, as `visible_files`."""
    return [entry for entry in visible_entries(folder) if entry.is_dir()]


def visible_entries(folder: Path) -> list[Path]:
    """The files and folders of a folder in natural order, without hidden ones, as `visible_files`."""
    try:
        return sorted((entry for entry in folder.iterdir() if not entry.name.startswith(".")), key=natural_order)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be listed ({error.strerror}); check the path") from error
