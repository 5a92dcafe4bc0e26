"""A robot description as URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from schemas.config import ExportConfig
from schemas.robot import Robot, RobotJoint, RobotLink
from stages.export.markup import document, mesh_files, numbers
from stages.export.robot import LEAST_RANGE
from stages.kernels.labelling.colours import distinct_colours

FILE = "robot.urdf"
BARE = 1e-3  # mass and inertia of a link between two joints of a child, as a share of the child's
LIMIT_MARGIN = ExportConfig().limit_margin  # of the hinges of a ball joint, beyond their range


def urdf_files(robot: Robot) -> dict[str, bytes]:
    """robot.urdf and the meshes that it names, by relative path. As usual in URDF, a moving base has no joint.

    The root's frame is the canonical frame. If the root's origin is moved to the object, its shapes have an offset.
    """
    root = ET.Element("robot", name=robot.name)
    # Options for MuJoCo. By default it looks for meshes beside the file and drops the visible ones. Contacts are off,
    # since URDF cannot exclude the pairs of links whose convex meshes overlap, as the MJCF does.
    extension = ET.SubElement(root, "mujoco")
    ET.SubElement(extension, "compiler", meshdir="meshes", strippath="true", discardvisual="false")
    ET.SubElement(ET.SubElement(extension, "option"), "flag", contact="disable")
    for index, colour in enumerate(distinct_colours(len(robot.links))):
        material = ET.SubElement(root, "material", name=f"colour_{index}")
        ET.SubElement(material, "color", rgba=numbers([*colour.round(3).tolist(), 1.0]))
    for index, link in enumerate(robot.links):
        _add_link(root, robot, index, link)
    for child in dict.fromkeys(joint.child for joint in robot.joints):
        _add_joints(root, robot, child)
    return {FILE: document(root, robot), **mesh_files(robot)}


def _add_link(root: ET.Element, robot: Robot, index: int, link: RobotLink) -> None:
    element = ET.SubElement(root, "link", name=link.name)
    offset = np.subtract(link.origin, _frame_origin(robot, index))
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=numbers(link.centre + offset), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=numbers([link.mass]))
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    ET.SubElement(inertial, "inertia", {name: numbers([v]) for name, v in zip(names, link.inertia, strict=True)})
    for role in ("visual", "collision"):
        for mesh in robot.meshes_of(index, role):
            shape = ET.SubElement(element, role)
            ET.SubElement(shape, "origin", xyz=numbers(offset) if offset.any() else "0 0 0", rpy="0 0 0")
            ET.SubElement(ET.SubElement(shape, "geometry"), "mesh", filename=mesh.file)
            if role == "visual" and robot.colours is None:  # a material would hide the mesh's own colours
                ET.SubElement(shape, "material", name=f"colour_{index}")


def _add_joints(root: ET.Element, robot: Robot, child: int) -> None:
    """Add the joints that move a link as a chain, with links of nearly no mass between them."""
    joints = [hinge for joint in robot.joints if joint.child == child for hinge in hinges(joint)]
    link, above = robot.links[child], joints[0].parent
    parent, offset = robot.links[above].name, np.subtract(link.origin, _frame_origin(robot, above))
    for joint in joints:
        name = link.name if joint is joints[-1] else f"{joint.name}_link"
        if joint is not joints[-1]:
            _add_bare_link(root, name, link)
        element = ET.SubElement(root, "joint", name=joint.name, type=joint.type)
        ET.SubElement(element, "parent", link=parent)
        ET.SubElement(element, "child", link=name)
        ET.SubElement(element, "origin", xyz=numbers(offset), rpy="0 0 0")
        ET.SubElement(element, "axis", xyz=numbers(joint.axis))
        limits = ("lower", "upper", "effort", "velocity")
        ET.SubElement(element, "limit", {name: numbers([getattr(joint, name)]) for name in limits})
        ET.SubElement(element, "dynamics", damping=numbers([joint.damping]), friction="0.0")
        parent, offset = name, np.zeros(3)


def _add_bare_link(root: ET.Element, name: str, child: RobotLink) -> None:
    """Add a link without a shape. Simulators refuse moving links without mass, so it has a little of its child's."""
    inertial = ET.SubElement(ET.SubElement(root, "link", name=name), "inertial")
    ET.SubElement(inertial, "origin", xyz="0 0 0", rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=numbers([BARE * child.mass]))
    moment = numbers([BARE * max(child.inertia[:3])])
    ET.SubElement(inertial, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0.0", ixz="0.0", iyz="0.0")


def hinges(joint: RobotJoint) -> list[RobotJoint]:
    """The joints that represent a joint in a URDF: itself, or for a ball three hinges, named `..._1` to `..._3`.

    The first axis is the direction of the largest fitted rotations, the second that of the smallest. A quarter turn of
    the second hinge would align the other two (gimbal lock).
    """
    if joint.type != "spherical":
        return [joint]
    states = np.array(joint.states)
    most, middle, _ = np.linalg.svd(np.concatenate([states, 1e-6 * np.eye(3)]), full_matrices=False)[2]
    axes = np.stack([most, np.cross(middle, most), middle])
    turns = Rotation.from_rotvec(states @ axes.T)
    angles = np.unwrap(turns.as_euler("XYZ"), axis=0)
    angles -= 2 * np.pi * np.round(angles[np.abs(states).sum(axis=1).argmin()] / (2 * np.pi))
    spread = np.ptp(angles, axis=0)
    margin = np.maximum(LIMIT_MARGIN * spread, (LEAST_RANGE - spread) / 2)
    return [
        joint.model_copy(
            update={
                "name": f"{joint.name}_{rank + 1}",
                "type": "revolute",
                "axis": tuple(axes[rank].tolist()),
                "lower": float(angles[:, rank].min() - margin[rank]),
                "upper": float(angles[:, rank].max() + margin[rank]),
                "states": tuple(angles[:, rank].tolist()),
            }
        )
        for rank in range(3)
    ]


def _frame_origin(robot: Robot, index: int) -> Float64[np.ndarray, "3"]:
    """The origin of a link's frame in the canonical frame. The root's frame is the canonical frame."""
    return np.zeros(3) if index == robot.root else np.array(robot.links[index].origin)
