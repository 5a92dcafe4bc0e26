"""Location of a robot's description: in the user's folder, in a PyPI package, or in a repository to clone.

Nothing here loads a mesh, so digests are cheap.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path, PurePath

from schemas.errors import InputError, UnavailableError
from stages.ingest.listing import visible_files, visible_folders
from stages.ingest.roboart.catalogue import Package, robot_entry
from stages.ingest.roboart.clones import CloneError, clone_description
from stages.ingest.roboart.mesh_files import mesh_references, resolve_mesh

ASSETS_VARIABLE = "REART_ASSETS"
BLOCK = 2**20  # bytes of a mesh in memory at a time
FOLDERS_UP = 4  # folders above a user's URDF that are searched for package:// names


@dataclass(frozen=True)
class Description:
    """A URDF file and the folders of its package:// names."""

    urdf_path: Path
    mesh_dirs: tuple[Path, ...]


def robot_description(name: str, assets: Path | None = None) -> Description:
    """Find a robot's description in the first source that has it: NAME/NAME.urdf in `assets`, a package, a clone.

    Raises InputError for an unknown name. Raises UnavailableError, which says how to get it, if no source has it.
    """
    entry = robot_entry(name)
    tried, remedies = [], []
    if assets is not None:
        if (found := _in_folder(name, assets)) is not None:
            return found
        tried.append(f"{assets} lacks {name}/{name}.urdf")
    if entry.package is not None:
        if (found := _in_package(entry.package)) is not None:
            return found
        tried.append(f"the package {entry.package.distribution} is not installed")
        remedies.append("run `pip install rearticulate[robots]`")
    if entry.module is not None:
        try:
            urdf_path, mesh_dirs = clone_description(entry.module)
            return Description(urdf_path, mesh_dirs)
        except CloneError as error:
            tried.append(str(error))
            remedies.append("try again with internet access")
    published = f" (from {entry.homepage})" if entry.homepage else ""
    remedies.append(f"put it{published} into FOLDER/{name}/{name}.urdf and give --assets FOLDER or {ASSETS_VARIABLE}")
    because = "; ".join(tried) or "no package on PyPI ships it"
    raise UnavailableError(f"robot {name!r}: found no URDF ({because}), expected one; {', or '.join(remedies)}")


def own_descriptions(path: Path) -> list[tuple[str, Description]]:
    """List the descriptions in a user's folder: its .urdf files, and those one level below, each in natural order.

    The only .urdf of a sub-folder is named after it (100129/mobility.urdf is 100129); several are named FOLDER-FILE. A
    sub-folder that cannot be listed counts as a description that cannot be read. `path` may also be a URDF file. Raises
    InputError if there is no description, or if `path` cannot be listed.
    """
    if path.is_file():
        return [(path.stem, _own(path))]
    found = [(file.stem, _own(file)) for file in _urdfs(path)]
    for folder in visible_folders(path):
        try:
            files = _urdfs(folder)
        except InputError:
            files = [folder]  # reading it reports the error
        found += [(folder.name if len(files) == 1 else f"{folder.name}-{file.stem}", _own(file)) for file in files]
    if not found:
        raise InputError(
            f"{path}: found no URDF, expected NAME.urdf or NAME/*.urdf there (no deeper, and no .xacro); check the path"
        )
    return found


def description_digest(found: Description) -> str:
    """SHA-256 (hex) over a URDF and every mesh file that it references.

    Raises InputError for a URDF that is not XML or lacks a mesh file, and for a file that cannot be read.
    """
    references = mesh_references(found.urdf_path)
    try:
        digest = hashlib.sha256(found.urdf_path.read_bytes())
        for reference in references:
            with resolve_mesh(reference, found.urdf_path, found.mesh_dirs).open("rb") as mesh:
                digest.update(f"{reference} {os.fstat(mesh.fileno()).st_size} ".encode())
                while block := mesh.read(BLOCK):
                    digest.update(block)
    except OSError as error:
        raise InputError(
            f"{error.filename}: cannot be read ({error.strerror}); check its name and permissions"
        ) from error
    return digest.hexdigest()


def _own(urdf_path: Path) -> Description:
    return Description(urdf_path, tuple(urdf_path.resolve().parents[:FOLDERS_UP]))


def _urdfs(folder: Path) -> list[Path]:
    return [file for file in visible_files(folder) if file.suffix.lower() == ".urdf"]


def _in_folder(name: str, assets: Path) -> Description | None:
    urdf_path = assets / name / f"{name}.urdf"
    return Description(urdf_path, (assets / name, assets)) if urdf_path.is_file() else None


def _in_package(package: Package) -> Description | None:
    try:
        distribution = metadata.distribution(package.distribution)
    except metadata.PackageNotFoundError:
        return None
    for file in distribution.files or ():
        if file.match(package.urdf):
            urdf_path = Path(str(distribution.locate_file(file))).resolve()
            if urdf_path.is_file():
                root = urdf_path.parents[len(PurePath(package.urdf).parts) - 1]
                return Description(urdf_path, (root,))
    return None
