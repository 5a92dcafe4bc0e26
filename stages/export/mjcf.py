"""A robot description as MJCF, MuJoCo's own format."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.robot import Robot, RobotJoint
from stages.export.markup import document, mesh_files, numbers
from stages.kernels.labelling.colours import distinct_colours

FILE = "robot.xml"
KINDS = {"revolute": "hinge", "prismatic": "slide", "spherical": "ball"}


def mjcf_files(robot: Robot) -> dict[str, bytes]:
    """robot.xml and the meshes that it names, by relative path.

    Links that touch do not collide. A moving base has a free joint. Key frame `frame_t` is the fitted frame t.
    """
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    asset = ET.SubElement(root, "asset")
    for mesh in robot.meshes:
        ET.SubElement(asset, "mesh", name=_stem(mesh.file), file=mesh.file, inertia="shell")
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "light", pos=numbers([0, 0, 10]), dir=numbers([0, 0, -1]), directional="true")
    order: list[RobotJoint] = []
    _add_body(world, robot, robot.root, None, order)
    if len(robot.touching):
        contact = ET.SubElement(root, "contact")
        for a, b in robot.touching.tolist():
            ET.SubElement(contact, "exclude", body1=robot.links[a].name, body2=robot.links[b].name)
    keyframe = ET.SubElement(root, "keyframe")
    for t in range(len(robot.T_frame_root)):
        ET.SubElement(keyframe, "key", name=f"frame_{t}", qpos=numbers(_positions(robot, order, t)))
    return {FILE: document(root, robot), **mesh_files(robot)}


def _add_body(above: ET.Element, robot: Robot, index: int, parent: int | None, order: list[RobotJoint]) -> None:
    """Add a link and its descendants. Append their joints to `order`, in the order of MuJoCo's qpos."""
    link = robot.links[index]
    origin = np.subtract(link.origin, np.zeros(3) if parent is None else robot.links[parent].origin)
    body = ET.SubElement(above, "body", name=link.name, pos=numbers(origin))
    inertial = {"pos": link.centre, "mass": [link.mass], "fullinertia": link.inertia}
    ET.SubElement(body, "inertial", {name: numbers(values) for name, values in inertial.items()})
    for joint in robot.joints:
        if joint.child == index:
            order.append(joint)
            _add_joint(body, joint)
    if parent is None and robot.free_base:
        ET.SubElement(body, "freejoint", name=f"{link.name}_free")
    colour = distinct_colours(len(robot.links))[index].round(3).tolist()
    for mesh in robot.meshes_of(index, "visual"):
        look = {"contype": "0", "conaffinity": "0", "group": "2", "rgba": numbers([*colour, 1.0])}
        ET.SubElement(body, "geom", {"type": "mesh", "mesh": _stem(mesh.file), **look})
    for mesh in robot.meshes_of(index, "collision"):
        ET.SubElement(body, "geom", type="mesh", mesh=_stem(mesh.file), group="3")
    for child in dict.fromkeys(below.child for below in robot.joints if below.parent == index):
        _add_body(body, robot, child, index, order)


def _add_joint(body: ET.Element, joint: RobotJoint) -> None:
    least = 0.0 if joint.type == "spherical" else joint.lower
    shape = {} if joint.type == "spherical" else {"axis": numbers(joint.axis)}
    limits = {
        "range": numbers([least, joint.upper]),
        "actuatorfrcrange": numbers([-joint.effort, joint.effort]),
        "damping": numbers([joint.damping]),
    }
    if joint.type == "spherical" and joint.upper >= np.pi:  # no rotation exceeds half a turn, so there is no limit
        del limits["range"]
    ET.SubElement(body, "joint", {"name": joint.name, "type": KINDS[joint.type], **shape, **limits})


def _positions(robot: Robot, order: list[RobotJoint], t: int) -> list[float]:
    """MuJoCo's qpos of a fitted frame: position and quaternion (w first) of a moving base, then the joints."""
    states = [value for joint in order for value in _position(joint, t)]
    if not robot.free_base:
        return states
    R, t_root = robot.T_frame_root[t, :3, :3], robot.T_frame_root[t, :3, 3]
    place = R @ robot.links[robot.root].origin + t_root
    quaternion = Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)
    return [*place.tolist(), *quaternion.tolist(), *states]


def _position(joint: RobotJoint, t: int) -> list[float]:
    """A joint's part of qpos: its state, or a ball's quaternion."""
    state = np.atleast_1d(joint.states[t])
    if joint.type != "spherical":
        return state.tolist()
    return Rotation.from_rotvec(state).as_quat(canonical=True, scalar_first=True).tolist()


def _stem(file: str) -> str:
    return file.rpartition("/")[2].rpartition(".")[0]
