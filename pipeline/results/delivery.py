"""Delivery of files into a folder of the user, with the digest of every file in `delivered.json`.

The digests reveal damage later. They also ensure that only our own unchanged files are ever removed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Literal

from pydantic import ValidationError

from pipeline.store.files import alone_in, check_own_folder, write_atomically, write_files
from schemas.artifact import Schema
from schemas.errors import InputError
from schemas.seal import BLANK, intact, sealed, sha256

RECORD = "delivered.json"
MESHES = "meshes"
DESCRIPTIONS = ("robot.urdf", "robot.xml")


class Delivery(Schema):
    """The content of delivered.json: the digest of each file by its path relative to the folder."""

    format: Literal["rearticulate/delivery"] = "rearticulate/delivery"
    version: Literal[1] = 1
    json_sha256: str = BLANK
    files: dict[str, str]


def deliver(folder: Path, files: Mapping[str, bytes], obsolete: Iterable[str] = ()) -> None:
    """Write files by their relative paths, each whole or not at all, and record their digests.

    The first file is written last, right after the second, which holds its arrays. So once the first file exists,
    everything that it needs exists too. Unchanged files of an earlier delivery are removed if they are `obsolete`, or
    meshes that no description in the folder names any more. Only one delivery at a time writes to a folder. Raises
    InputError as `check_target` does.
    """
    with alone_in(folder):
        check_target(folder)
        _deliver(folder, files, obsolete)


def _deliver(folder: Path, files: Mapping[str, bytes], obsolete: Iterable[str]) -> None:
    earlier = _recorded(folder)
    digests = earlier | {name: sha256(content) for name, content in files.items()}
    names = list(files)
    write_files(folder, {name: files[name] for name in names[2:]})
    _record(folder, digests)
    write_files(folder, {name: files[name] for name in names[:2]})
    if unneeded := _unneeded(folder, earlier.keys() - files.keys(), obsolete):
        for name in unneeded:
            if _digest(folder / name) == earlier[name]:
                (folder / name).unlink()
        _record(folder, {name: digest for name, digest in digests.items() if name not in unneeded})


def check_target(folder: Path) -> None:
    """Raise InputError if a link or a folder stands where a file would go, or if the folder's record is damaged."""
    check_own_folder(folder / MESHES)
    for name in (RECORD, *DESCRIPTIONS, "model.json", "model.npz", "report.html", "metrics.json"):
        if (folder / name).is_dir():
            raise InputError(f"{folder / name}: found a folder, expected a file; remove it, or name another folder")
    _recorded(folder)


def check_delivery(folder: Path) -> list[str]:
    """The problems of the files that were delivered into a folder, one line each.

    Raises InputError if their record is missing or damaged.
    """
    digests = _read(folder / RECORD)
    problems = []
    for name, digest in sorted(digests.items()):
        try:
            if not (folder / name).is_file():
                problems.append(f"{name}: missing")
            elif sha256((folder / name).read_bytes()) != digest:
                problems.append(f"{name}: its bytes were changed (its digest differs)")
        except OSError as error:
            problems.append(f"{name}: cannot be read ({error.strerror})")
    return problems


def _unneeded(folder: Path, names: Iterable[str], obsolete: Iterable[str]) -> list[str]:
    """Those of the named files that are obsolete, or meshes that no description names."""
    named = b"".join((folder / name).read_bytes() for name in DESCRIPTIONS if (folder / name).is_file())
    return [
        name
        for name in sorted(names)
        if name in obsolete or (name.startswith(f"{MESHES}/") and name.encode() not in named)
    ]


def _digest(path: Path) -> str | None:
    """The digest of a file; None if it is missing or a link."""
    return sha256(path.read_bytes()) if path.is_file() and not path.is_symlink() else None


def _recorded(folder: Path) -> dict[str, str]:
    """The digests of an earlier delivery; none without one. Raises InputError for a damaged record."""
    record = folder / RECORD
    return _read(record) if record.is_file() and not record.is_symlink() else {}


def _record(folder: Path, digests: Mapping[str, str]) -> None:
    record = Delivery(files=dict(sorted(digests.items())))
    write_atomically(folder / RECORD, sealed(json.dumps(record.model_dump(), indent=1).encode() + b"\n"))


def _read(path: Path) -> dict[str, str]:
    """Read the digests of a record. Raises InputError if the record is missing or damaged."""
    remedy = "remove it, and give the command that filled this folder again"
    try:
        content = path.read_bytes()
        record = Delivery.model_validate_json(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {remedy}") from error
    except ValidationError as error:
        raise InputError(f"{path}: found no record of delivered files; {remedy}") from error
    if not intact(content, record.json_sha256):
        raise InputError(f"{path}: its bytes were changed (its digest differs); {remedy}")
    if strange := [name for name in record.files if not _lies_below(name)]:
        raise InputError(f"{path}: found the name {strange[0][:80]!r}, expected paths in this folder; {remedy}")
    return record.files


def _lies_below(name: str) -> bool:
    """Whether a name is that of a file in the folder, or in its folder of meshes."""
    parts = PurePosixPath(name).parts
    return name.isprintable() and parts[-1:] != ("..",) and (len(parts) == 1 or parts[:-1] == (MESHES,))
