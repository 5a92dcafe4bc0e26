"""Which mesh files a URDF names, and where they are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from schemas.errors import InputError


def read_xml(urdf_path: Path) -> ElementTree.Element:
    """The root element of a URDF. Raises InputError where it is missing or not well-formed."""
    try:
        return ElementTree.parse(urdf_path).getroot()
    except (OSError, ValueError, LookupError, ElementTree.ParseError) as error:  # an encoding may be unknown
        raise InputError(f"{urdf_path}: cannot be read as XML ({error}), expected a URDF file; replace it") from error


def mesh_references(urdf_path: Path) -> list[str]:
    """The mesh file names of a URDF as written there, without repeats, in alphabetical order."""
    return sorted({mesh.get("filename", "") for mesh in read_xml(urdf_path).iter("mesh")})


def resolve_mesh(reference: str, urdf_path: Path, mesh_dirs: Sequence[Path]) -> Path:
    """The file that a mesh reference stands for.

    `package://NAME/REST` is NAME/REST in one of `mesh_dirs`; other names are relative to the URDF.
    Raises InputError where there is no such file.
    """
    scheme, separator, rest = reference.partition("://")
    if separator and scheme == "package":
        candidates = [folder / rest for folder in mesh_dirs]
    else:
        candidates = [urdf_path.parent / (rest if separator else reference)]
    for path in candidates:
        if path.is_file():
            return path
    looked = " or ".join(str(path) for path in candidates) or "no folder, as none was given"
    raise InputError(f"{urdf_path}: mesh {reference!r} not found, looked for {looked}; restore that file")
