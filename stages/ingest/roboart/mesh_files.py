"""The XML of a URDF, and the mesh files that it references."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from schemas.errors import InputError, quoted

MOST_URDF_MIB = 64


class WithoutDoctype(ElementTree.TreeBuilder):
    """A tree builder that refuses document type declarations, whose entities may expand to any amount of text."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise ValueError("found a document type declaration, <!DOCTYPE>, expected none")


def read_xml(urdf_path: Path) -> ElementTree.Element:
    """Read the root element of a URDF. Raises InputError if the file is missing, too large or not well-formed."""
    try:
        size = urdf_path.stat().st_size
        if size > MOST_URDF_MIB * 2**20:
            raise ValueError(f"found {size / 2**20:.0f} MiB, expected at most {MOST_URDF_MIB}")
        return ElementTree.parse(urdf_path, ElementTree.XMLParser(target=WithoutDoctype())).getroot()
    except (OSError, ValueError, LookupError, ElementTree.ParseError) as error:  # an encoding may be unknown
        raise InputError(f"{urdf_path}: cannot be read as XML ({error}), expected a URDF file; replace it") from error


def mesh_references(urdf_path: Path) -> list[str]:
    """The mesh file names of a URDF as written there, without repeats, in alphabetical order.

    `check_urdf` reports a mesh without a file name, with its link.
    """
    return sorted({name for mesh in read_xml(urdf_path).iter("mesh") if (name := mesh.get("filename"))})


def resolve_mesh(reference: str, urdf_path: Path, mesh_dirs: Sequence[Path]) -> Path:
    """Resolve a mesh reference to a file.

    `package://NAME/REST` is NAME/REST in one of `mesh_dirs`. Other names are relative to the URDF. Raises InputError if
    there is no such file.
    """
    scheme, separator, rest = reference.partition("://")
    if separator and scheme == "package":
        candidates = [folder / rest for folder in mesh_dirs]
    else:
        candidates = [urdf_path.parent / (rest if separator else reference)]
    for path in candidates:
        if os.path.isfile(path):  # unlike Path.is_file, returns False for impossible names
            return path
    looked = " or ".join(str(path) for path in candidates) or "no folder, as none was given"
    raise InputError(f"{urdf_path}: mesh {quoted(reference)} not found, looked for {looked}; restore that file")
