from __future__ import annotations

import mujoco
import numpy as np
import pytest
import yourdfpy

from schemas.errors import InputError
from schemas.joints import FIXED
from stages.ingest.roboart.catalogue import ROBOTS
from stages.ingest.roboart.descriptions import robot_description
from stages.ingest.roboart.motion import drive_ranges, follow, rest_positions
from stages.ingest.roboart.urdf import Robot, forward_kinematics, read_urdf


def random_positions(robot: Robot, count: int) -> np.ndarray:
    lower, upper = drive_ranges(robot).T
    positions = np.random.default_rng(0).uniform(lower, np.maximum(lower, upper), (count, len(lower)))
    return follow(robot, positions, np.ones(len(lower), dtype=bool))


def assert_agrees_with_yourdfpy(path, tolerance=1e-6):
    robot = read_urdf(path)
    oracle = yourdfpy.URDF.load(str(path), load_meshes=False)
    positions = random_positions(robot, 3)
    for row, Ts_base_link in zip(positions, forward_kinematics(robot, positions), strict=True):
        oracle.update_cfg({j.name: q for j, q in zip(robot.joints, row, strict=True) if j.name in oracle.joint_map})
        for link, T_base_link in zip(robot.links, Ts_base_link, strict=True):
            np.testing.assert_allclose(T_base_link, oracle.get_transform(link, robot.links[0]), atol=tolerance)


def test_forward_kinematics_agrees_with_yourdfpy_on_the_arm(arm):
    assert_agrees_with_yourdfpy(arm)


@pytest.mark.parametrize("name", [name for name, entry in ROBOTS.items() if entry.package is not None])
def test_forward_kinematics_agrees_with_yourdfpy_on_every_packaged_robot(name):
    if name == "iiwa":
        pytest.importorskip("pybullet_data", reason="pybullet has no wheel for every Python")
    assert_agrees_with_yourdfpy(robot_description(name).urdf_path)


def test_forward_kinematics_agrees_with_mujoco_on_the_arm(arm):
    robot = read_urdf(arm)
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    compiler = '<mujoco><compiler fusestatic="false" strippath="true"/></mujoco>'
    text = arm.read_text().replace("</link>", f"{inertial}</link>").replace('">', f'">{compiler}', 1)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for row, Ts_base_link in zip(
        random_positions(robot, 5), forward_kinematics(robot, random_positions(robot, 5)), strict=True
    ):
        for joint, position in zip(robot.joints, row, strict=True):
            if joint.kind != FIXED:
                data.joint(joint.name).qpos[0] = position
        mujoco.mj_kinematics(model, data)
        for link, T_base_link in zip(robot.links[1:], Ts_base_link[1:], strict=True):
            np.testing.assert_allclose(T_base_link[:3, 3], data.body(link).xpos, atol=1e-6)
            np.testing.assert_allclose(T_base_link[:3, :3].ravel(), data.body(link).xmat, atol=1e-6)


def test_joints_are_ordered_so_that_joint_j_moves_link_j_plus_one(arm):
    robot = read_urdf(arm)
    assert robot.links[0] == "world"
    assert [joint.child for joint in robot.joints] == list(range(1, len(robot.links)))
    assert all(joint.parent < joint.child for joint in robot.joints)


def test_a_limit_of_ten_radians_or_more_counts_as_none(urdf):
    path = urdf.write(
        urdf.link("a"), urdf.link("b"), urdf.joint("j", "revolute", "a", "b", urdf.moves("1 0 0", -1e16, 10.0))
    )
    (joint,) = read_urdf(path).joints
    assert (joint.lower, joint.upper) == (-np.pi, np.pi)


def test_joints_rest_at_zero_or_amid_limits_that_exclude_it(arm):
    robot = read_urdf(arm)
    rest = dict(zip([joint.name for joint in robot.joints], rest_positions(robot, drive_ranges(robot)), strict=True))
    assert rest["elbow"] == 0
    assert rest["rail"] == pytest.approx(-0.2)
    assert rest["shoulder"] == pytest.approx((0.3 + 2.2) / 2)  # 2.2: where `echo` reaches its own lower limit
    assert rest["echo"] == pytest.approx(0.6 - 0.5 * rest["shoulder"])


@pytest.mark.parametrize(
    ("elements", "message"),
    [
        (["<link name='a'/>", "<link name='b'/>"], "2 links without a parent"),
        (["<link name='a'/>", "<joint name='j' type='fixed'><parent link='a'/><child link='z'/></joint>"], "'z'"),
        (["<link name='a'/>", "<joint name='j' type='fixed'><child link='a'/></joint>"], "joint 'j': found no parent"),
        (["<link name='a'>"], "cannot be read as XML"),
    ],
)
def test_a_broken_description_is_refused_in_one_line_that_names_the_file(urdf, elements, message):
    path = urdf.write(*elements)
    with pytest.raises(InputError) as caught:
        read_urdf(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_loop_of_links_is_refused(urdf):
    names = ("root", "a", "b")
    path = urdf.write(
        *(urdf.link(name) for name in names), urdf.joint("j", "fixed", "a", "b"), urdf.joint("k", "fixed", "b", "a")
    )
    with pytest.raises(InputError, match="loop"):
        read_urdf(path)


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ('<axis xyz="0 0 0"/>', "axis of length zero"),
        ('<axis xyz="1 0 0"/><limit lower="1" upper="-1"/>', "lower <= upper"),
        ('<axis xyz="1 0 0"/><mimic joint="nobody"/>', "'nobody'"),
        ('<axis xyz="1 0 0"/><mimic joint="hinge"/>', "itself"),
    ],
)
def test_a_contradictory_joint_is_refused_by_name(urdf, extra, message):
    path = urdf.write(urdf.link("a"), urdf.link("b"), urdf.joint("hinge", "revolute", "a", "b", extra))
    with pytest.raises(InputError, match=message) as caught:
        read_urdf(path)
    assert "'hinge'" in str(caught.value)


def test_a_joint_that_mimics_a_mimic_follows_the_one_that_leads(urdf):
    def mimic(of, multiplier, offset):
        return f'<axis xyz="1 0 0"/><mimic joint="{of}" multiplier="{multiplier}" offset="{offset}"/>'

    path = urdf.write(
        *(urdf.link(name) for name in "abcd"),
        urdf.joint("third", "continuous", "a", "d", mimic("second", -2, 0.5)),
        urdf.joint("second", "continuous", "a", "c", mimic("first", 3, 0.1)),
        urdf.joint("first", "continuous", "a", "b", '<axis xyz="1 0 0"/>'),
    )
    joints = {joint.name: (index, joint) for index, joint in enumerate(read_urdf(path).joints)}
    third = joints["third"][1].mimic
    assert third.joint == joints["first"][0]
    assert (third.multiplier, third.offset) == pytest.approx((-6, -2 * 0.1 + 0.5))
