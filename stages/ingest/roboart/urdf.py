"""Reading of robot descriptions, and their forward kinematics."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import tostring

import numpy as np
from jaxtyping import Float64

from schemas.errors import InputError, quoted
from schemas.joints import FIXED, PRISMATIC, REVOLUTE, JointKind
from stages.ingest.roboart.mesh_files import read_xml
from stages.ingest.roboart.urdf_check import check_urdf, pruned
from stages.kernels.kinematics.tree import KinematicTree

# `continuous` is a revolute joint without limits; floating and planar joints are held, as the base is
KINDS: dict[str, JointKind] = {
    "fixed": FIXED,
    "floating": FIXED,
    "planar": FIXED,
    "revolute": REVOLUTE,
    "continuous": REVOLUTE,
    "prismatic": PRISMATIC,
}
# descriptions write "no limit" as a large number, mostly 10 or 1e16
NO_LIMIT = 10.0


@dataclass(frozen=True)
class Mimic:
    """A mimic joint's rule: position = multiplier * (position of the leading joint) + offset."""

    joint: int
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint between two links, in metres and radians; `axis` is in the joint's own frame."""

    name: str
    kind: JointKind
    parent: int
    child: int
    T_parent_joint: Float64[np.ndarray, "4 4"]
    axis: Float64[np.ndarray, "3"]
    lower: float
    upper: float
    mimic: Mimic | None = None


@dataclass(frozen=True)
class Shape:
    """One visual or collision element of a link; `geometry` as yourdfpy parsed it."""

    T_link_shape: Float64[np.ndarray, "4 4"]
    geometry: Any


@dataclass(frozen=True)
class Robot:
    """A tree of links. Link 0 is the base, joint j moves link j + 1, and parents come before children."""

    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    visuals: tuple[tuple[Shape, ...], ...]
    collisions: tuple[tuple[Shape, ...], ...]

    @cached_property
    def Ts_base_link(self) -> Float64[np.ndarray, "links 4 4"]:
        """The links' frames in the base's frame, with all positions zero."""
        Ts = [np.eye(4)]
        for joint in self.joints:
            Ts.append(Ts[joint.parent] @ joint.T_parent_joint)
        return np.stack(Ts)

    @cached_property
    def tree(self) -> KinematicTree:
        """The tree of links and joints in the base's frame, with all positions zero."""
        Ts_base_child = self.Ts_base_link[1:]
        axes = np.array([joint.axis for joint in self.joints]).reshape(-1, 3)
        return KinematicTree(
            kinds=tuple(joint.kind for joint in self.joints),
            parent=np.array([joint.parent for joint in self.joints], dtype=np.int64),
            child=np.array([joint.child for joint in self.joints], dtype=np.int64),
            axis=(Ts_base_child[:, :3, :3] @ axes[..., None])[..., 0],
            point=Ts_base_child[:, :3, 3],
            root=0,
        )


def import_extra(module: str) -> Any:
    """Import a module of the optional extra `robots`. Raises InputError if it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InputError(
            f"dataset roboart: cannot import {module} ({error}); run `pip install rearticulate[robots]`"
        ) from error


def read_urdf(urdf_path: Path) -> Robot:
    """Read a URDF's links and joints. No mesh is loaded.

    Raises InputError for a file that is not a URDF, for invalid numbers or names, for links that do not form a tree,
    and for contradictory joints.
    """
    root = read_xml(urdf_path)
    check_urdf(root, urdf_path)  # yourdfpy accepts any number and name
    yourdfpy = import_extra("yourdfpy")
    try:
        parsed = yourdfpy.URDF.load(BytesIO(tostring(pruned(root))), build_scene_graph=False, load_meshes=False).robot
    except Exception as error:  # yourdfpy has no common error for unparsable files
        raise InputError(f"{urdf_path}: cannot be read as a URDF ({error!r}); correct or replace it") from error
    links = {link.name: link for link in parsed.links}
    joints = _from_root(parsed.joints, links, urdf_path)
    order = [joints[0].parent, *(joint.child for joint in joints)] if joints else list(links)
    index = {name: k for k, name in enumerate(order)}
    by_name = {joint.name: (k, joint) for k, joint in enumerate(joints)}
    return Robot(
        links=tuple(order),
        joints=tuple(_joint(joint, index, by_name, urdf_path) for joint in joints),
        visuals=tuple(_shapes(links[name].visuals) for name in order),
        collisions=tuple(_shapes(links[name].collisions) for name in order),
    )


def forward_kinematics(
    robot: Robot, positions: Float64[np.ndarray, "states joints"]
) -> Float64[np.ndarray, "states links 4 4"]:
    """Each link's frame in the base's frame, for `positions` in radians or metres. Those of fixed joints are unused."""
    moving = [joint.kind != FIXED for joint in robot.joints]
    return robot.tree.Ts_pose_canonical(positions[:, moving]) @ robot.Ts_base_link


def _from_root(joints: list[Any], links: dict[str, Any], urdf_path: Path) -> list[Any]:
    """The joints, depth first from the base, so that a link's own joint comes before those of its children."""
    moved_by: dict[str, Any] = {}
    children: dict[str, list[Any]] = {}
    for joint in joints:
        for name in (joint.parent, joint.child):
            if name not in links:
                raise _no_tree(urdf_path, f"joint {quoted(joint.name)} of the unknown link {quoted(name)}")
        if (other := moved_by.setdefault(joint.child, joint)) is not joint:
            raise _no_tree(
                urdf_path,
                f"link {quoted(joint.child)} with two parents, by joints {quoted(other.name)}, {quoted(joint.name)}",
            )
        children.setdefault(joint.parent, []).append(joint)
    roots = [name for name in links if name not in moved_by]
    if len(roots) != 1:
        named = f": {', '.join(map(quoted, roots[:3]))}{', ...' * (len(roots) > 3)}" if roots else ""
        raise _no_tree(urdf_path, f"{len(roots)} links without a parent{named}")
    ordered: list[Any] = []
    front = children.get(roots[0], [])[::-1]
    while front:
        joint = front.pop()
        ordered.append(joint)
        front += children.get(joint.child, [])[::-1]
    if len(ordered) != len(joints):
        reached = {roots[0], *(joint.child for joint in ordered)}
        looped = next(name for name in links if name not in reached)
        raise _no_tree(urdf_path, f"link {quoted(looped)} in a loop, or hanging on one")
    return ordered


def _no_tree(urdf_path: Path, found: str) -> InputError:
    return InputError(f"{urdf_path}: found {found}, expected one tree of links; correct the URDF")


def _joint(joint: Any, links: dict[str, int], by_name: dict[str, tuple[int, Any]], urdf_path: Path) -> Joint:
    where = f"{urdf_path}: joint {quoted(joint.name)}"
    if joint.type not in KINDS:
        raise InputError(
            f"{where}: found type {quoted(joint.type)}, expected one of {', '.join(KINDS)}; correct the URDF"
        )
    kind = KINDS[joint.type]
    length = float(np.linalg.norm(joint.axis))
    if kind != FIXED and length == 0:
        raise InputError(f"{where}: found an axis of length zero, expected a direction; correct the URDF")
    lower, upper = (0.0, 0.0) if kind == FIXED else _limits(joint)
    if lower > upper:
        raise InputError(f"{where}: found limits {lower} to {upper}, expected lower <= upper; correct the URDF")
    return Joint(
        name=joint.name,
        kind=kind,
        parent=links[joint.parent],
        child=links[joint.child],
        T_parent_joint=_origin(joint),
        axis=np.asarray(joint.axis, dtype=np.float64) / (length or 1.0),
        lower=lower,
        upper=upper,
        mimic=None if kind == FIXED else _mimic(joint, by_name, where),
    )


def _mimic(joint: Any, by_name: dict[str, tuple[int, Any]], where: str) -> Mimic | None:
    """The rule of a mimic joint. Chains of mimic joints are resolved to the joint that leads them all."""
    if joint.mimic is None:
        return None
    index, multiplier, offset = -1, 1.0, 0.0
    passed = {joint.name}
    while joint.mimic is not None:
        leader = joint.mimic.joint
        if leader not in by_name or leader in passed:
            found = "itself" if leader in passed else f"the unknown joint {quoted(leader)}"
            raise InputError(f"{where}: found that it mimics {found}, expected another joint; correct the URDF")
        passed.add(leader)
        offset += multiplier * joint.mimic.offset
        multiplier *= joint.mimic.multiplier
        index, joint = by_name[leader]
    return Mimic(index, multiplier, offset)


def _limits(joint: Any) -> tuple[float, float]:
    """The lower and upper limit. Without limits they are half a turn to either side, or zero if prismatic."""
    free = 0.0 if joint.type == "prismatic" else np.pi
    if joint.limit is None or joint.type == "continuous":
        return -free, free
    lower, upper = joint.limit.lower, joint.limit.upper
    return (
        -free if lower is None or abs(lower) >= NO_LIMIT else lower,
        free if upper is None or abs(upper) >= NO_LIMIT else upper,
    )


def _shapes(elements: list[Any]) -> tuple[Shape, ...]:
    return tuple(Shape(_origin(element), element.geometry) for element in elements if element.geometry is not None)


def _origin(element: Any) -> Float64[np.ndarray, "4 4"]:
    return np.eye(4) if element.origin is None else np.asarray(element.origin, dtype=np.float64)
