"""A robot description as URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from jaxtyping import Float64

from schemas.robot import Robot, RobotJoint, RobotLink
from stages.export.markup import document, mesh_files, numbers
from stages.kernels.labelling.colours import distinct_colours

FILE = "robot.urdf"


def urdf_files(robot: Robot) -> dict[str, bytes]:
    """robot.urdf and the meshes that it names, by relative path. A moving base has a plain root, as URDF's way is.

    The root's frame is the canonical frame: where its origin is beside the object, that is told of its shapes.
    """
    root = ET.Element("robot", name=robot.name)
    # read by MuJoCo, which otherwise looks for meshes beside the file, drops the visible ones, and pushes links apart
    # whose convex meshes overlap: URDF cannot exclude such pairs, as the MJCF does
    extension = ET.SubElement(root, "mujoco")
    ET.SubElement(extension, "compiler", meshdir="meshes", strippath="true", discardvisual="false")
    ET.SubElement(ET.SubElement(extension, "option"), "flag", contact="disable")
    for index, colour in enumerate(distinct_colours(len(robot.links))):
        material = ET.SubElement(root, "material", name=f"colour_{index}")
        ET.SubElement(material, "color", rgba=numbers([*colour.round(3).tolist(), 1.0]))
    for index, link in enumerate(robot.links):
        _add_link(root, robot, index, link)
    for joint in robot.joints:
        _add_joint(root, robot, joint)
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
            if role == "visual":
                ET.SubElement(shape, "material", name=f"colour_{index}")


def _add_joint(root: ET.Element, robot: Robot, joint: RobotJoint) -> None:
    parent, child = robot.links[joint.parent], robot.links[joint.child]
    offset = np.subtract(child.origin, _frame_origin(robot, joint.parent))
    element = ET.SubElement(root, "joint", name=joint.name, type=joint.type)
    ET.SubElement(element, "parent", link=parent.name)
    ET.SubElement(element, "child", link=child.name)
    ET.SubElement(element, "origin", xyz=numbers(offset), rpy="0 0 0")
    ET.SubElement(element, "axis", xyz=numbers(joint.axis))
    limits = ("lower", "upper", "effort", "velocity")
    ET.SubElement(element, "limit", {name: numbers([getattr(joint, name)]) for name in limits})
    ET.SubElement(element, "dynamics", damping=numbers([joint.damping]), friction="0.0")


def _frame_origin(robot: Robot, index: int) -> Float64[np.ndarray, "3"]:
    """Where a link's frame stands in the canonical frame. No joint places the root's."""
    return np.zeros(3) if index == robot.root else np.array(robot.links[index].origin)
