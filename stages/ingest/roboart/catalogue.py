"""Which robots there are and where their descriptions lie.

So far the ones that the PyPI package example-robot-data ships. Nothing here loads a mesh, so that names
and digests are cheap.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from schemas.errors import InputError
from stages.ingest.roboart.mesh_files import mesh_references, resolve_mesh

RobotKind = Literal["arm", "biped", "hand", "quadruped"]

DISTRIBUTION = "example-robot-data"
SHARE_FOLDER = "cmeel.prefix/share"
ROBOTS_FOLDER = "example-robot-data/robots"


@dataclass(frozen=True)
class RobotSource:
    """A robot's description, relative to the package's folder of robots, and its type (Table 3)."""

    urdf: str
    kind: RobotKind


ROBOTS: dict[str, RobotSource] = {
    "a1": RobotSource("a1_description/urdf/a1.urdf", "quadruped"),
    "allegro": RobotSource("allegro_hand_description/urdf/allegro_right_hand.urdf", "hand"),
    "baxter": RobotSource("baxter_description/urdf/baxter.urdf", "arm"),
    "bolt": RobotSource("bolt_description/robots/bolt.urdf", "biped"),
    "kinova": RobotSource("kinova_description/robots/kinova.urdf", "arm"),
    "laikago": RobotSource("laikago_description/urdf/laikago.urdf", "quadruped"),
    "panda": RobotSource("panda_description/urdf/panda.urdf", "arm"),
    "solo": RobotSource("solo_description/robots/solo12.urdf", "quadruped"),
    "ur5": RobotSource("ur_description/urdf/ur5_robot.urdf", "arm"),
}


def robot_names() -> list[str]:
    """The names that `build_sequence` and `robot_digest` know, in alphabetical order."""
    return sorted(ROBOTS)


def robot_description(name: str) -> tuple[Path, tuple[Path, ...]]:
    """A robot's URDF file and the folders in which its package:// names are looked up.

    Raises InputError for an unknown name, or where example-robot-data is missing or lacks the file.
    """
    if name not in ROBOTS:
        raise InputError(f"robot {name!r}: not known, expected one of {', '.join(robot_names())}")
    try:
        distribution = metadata.distribution(DISTRIBUTION)
    except metadata.PackageNotFoundError as error:
        raise InputError(
            f"robot {name!r}: found no package {DISTRIBUTION}, which holds its description; "
            "run `pip install rearticulate[robots]`"
        ) from error
    share = Path(str(distribution.locate_file(SHARE_FOLDER))).resolve()
    urdf_path = share / ROBOTS_FOLDER / ROBOTS[name].urdf
    if not urdf_path.is_file():
        raise InputError(
            f"robot {name!r}: found no file {urdf_path}, expected {DISTRIBUTION} {distribution.version} to ship it; "
            "run `pip install --force-reinstall rearticulate[robots]`"
        )
    return urdf_path, (share,)


def robot_digest(name: str) -> str:
    """SHA-256 (hex) over the robot's URDF and every mesh file that it references.

    Raises InputError as `robot_description`, and for a missing mesh file.
    """
    urdf_path, mesh_dirs = robot_description(name)
    digest = hashlib.sha256(urdf_path.read_bytes())
    for reference in mesh_references(urdf_path):
        mesh = resolve_mesh(reference, urdf_path, mesh_dirs).read_bytes()
        digest.update(f"{reference} {len(mesh)} ".encode())
        digest.update(mesh)
    return digest.hexdigest()
