from __future__ import annotations

import numpy as np

from stages.ingest.roboart.parts import rigid_parts
from stages.ingest.roboart.urdf import read_urdf


def chain(urdf, tree, mimics=()):
    """A robot whose links hang on one another by hinges as (child, parent) pairs tell."""
    names = ["base", *(child for child, _ in tree)]
    joints = [
        urdf.joint(
            f"j_{child}",
            "revolute",
            parent,
            child,
            urdf.moves("1 0 0", -1, 1) + (f'<mimic joint="j_{dict(mimics)[child]}"/>' if child in dict(mimics) else ""),
        )
        for child, parent in tree
    ]
    return read_urdf(urdf.write(*(urdf.link(name) for name in names), *joints))


def groups(robot, areas, share=0.02):
    """The parts as sets of link names, and the joint that moves each."""
    area = np.array([areas.get(name, 0.0) for name in robot.links])
    parts = rigid_parts(robot, area, np.ones(len(robot.joints), dtype=bool), share)
    members = ["+".join(np.array(robot.links)[parts.part_of_link == part]) for part in range(len(parts.link))]
    names = [robot.joints[joint].name for joint in parts.joint[1:]]
    return members, names, parts.parent.tolist()


def test_links_of_visible_size_are_parts_of_their_own(urdf):
    robot = chain(urdf, [("a", "base"), ("b", "a"), ("c", "base")])
    found = groups(robot, {"base": 1, "a": 1, "b": 1, "c": 1})
    assert found == (["base", "a", "b", "c"], ["j_a", "j_b", "j_c"], [-1, 0, 1, 0])


def test_a_small_leaf_joins_its_parent_and_its_joint_is_held(urdf):
    robot = chain(urdf, [("a", "base"), ("tip", "a")])
    assert groups(robot, {"base": 1, "a": 1, "tip": 0.01}) == (["base", "a+tip"], ["j_a"], [-1, 0])


def test_small_links_that_add_up_to_a_visible_part_stay_one(urdf):
    robot = chain(urdf, [("a", "base"), ("b", "a"), ("c", "b")])
    found = groups(robot, {"base": 1, "a": 0.01, "b": 0.01, "c": 0.01})
    assert found == (["base", "a+b+c"], ["j_a"], [-1, 0])


def test_a_hip_of_three_joints_leaves_one_between_two_visible_parts(urdf):
    robot = chain(urdf, [("yaw", "base"), ("roll", "yaw"), ("leg", "roll"), ("foot", "leg")])
    found = groups(robot, {"base": 1, "roll": 0.001, "leg": 1, "foot": 1})
    assert found == (["base+yaw+roll", "leg", "foot"], ["j_leg", "j_foot"], [-1, 0, 1])


def test_a_base_without_surface_takes_in_its_largest_child(urdf):
    robot = chain(urdf, [("left", "base"), ("right", "base"), ("hand", "right")])
    found = groups(robot, {"left": 1, "right": 2, "hand": 1})
    assert found == (["base+right", "left", "hand"], ["j_left", "j_hand"], [-1, 0, 0])


def test_a_joint_is_held_with_the_joint_that_it_mimics(urdf):
    robot = chain(urdf, [("small", "base"), ("large", "base"), ("other", "base")], mimics=[("large", "small")])
    found = groups(robot, {"base": 1, "small": 0.001, "large": 1, "other": 1})
    assert found == (["base+small+large", "other"], ["j_other"], [-1, 0])


def test_without_a_least_share_links_without_surface_still_join(urdf):
    robot = chain(urdf, [("frame", "base"), ("a", "frame")])
    assert groups(robot, {"base": 1, "a": 1e-6}, share=0.0) == (["base+frame", "a"], ["j_a"], [-1, 0])


def test_a_robot_without_any_surface_is_one_part(urdf):
    assert groups(chain(urdf, [("a", "base")]), {})[0] == ["base+a"]
