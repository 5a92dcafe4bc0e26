"""Grouping of a description's links to the rigid parts of a sequence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from stages.ingest.roboart.urdf import Robot


@dataclass(frozen=True)
class Parts:
    """Rigid groups of links. Part 0 holds the base, and parents come before children.

    `link[p]` is the topmost link of part p, whose frame is the part's frame. `joint[p]` is the joint that moves the
    part (-1 for part 0).
    """

    part_of_link: Int64[np.ndarray, "links"]
    link: Int64[np.ndarray, "parts"]
    joint: Int64[np.ndarray, "parts"]
    parent: Int64[np.ndarray, "parts"]


def top_links(robot: Robot, moving: Bool[np.ndarray, "joints"]) -> Int64[np.ndarray, "links"]:
    """The topmost link of each link's rigid group, if only `moving` joints move."""
    top = np.arange(len(robot.links))
    for index, joint in enumerate(robot.joints):
        if not moving[index]:
            top[joint.child] = top[joint.parent]
    return top


def rigid_parts(
    robot: Robot,
    link_area: Float64[np.ndarray, "links"],
    movable: Bool[np.ndarray, "joints"],
    min_share: float,
) -> Parts:
    """Join groups of links with at most `min_share` of the whole surface to their parents, leaves first.

    A small base absorbs its largest child instead. Every remaining joint moves one visible part relative to another. A
    mimic joint is held if its leading joint is held.
    """
    moving = movable.copy()
    least = min_share * link_area.sum()
    while True:
        led = (joint.mimic is None or moving[joint.mimic.joint] for joint in robot.joints)
        moving &= np.fromiter(led, dtype=bool)
        top = top_links(robot, moving)
        area = np.bincount(top, weights=link_area, minlength=len(robot.links))
        joints = np.flatnonzero(moving)
        children = joints + 1  # joint j moves link j + 1
        small = joints[area[children] <= least]
        if len(small):
            moving[small[-1]] = False  # the last one has no small group below
        elif area[0] <= least and len(joints):
            at_base = joints[top[[robot.joints[joint].parent for joint in joints]] == 0]
            moving[at_base[np.argmax(area[at_base + 1])]] = False
        else:
            return _parts(robot, moving, top)


def _parts(robot: Robot, moving: Bool[np.ndarray, "joints"], top: Int64[np.ndarray, "links"]) -> Parts:
    link, part_of_link = np.unique(top, return_inverse=True)
    joint = link - 1
    parent = [-1, *(int(part_of_link[robot.joints[j].parent]) for j in joint[1:])]
    return Parts(part_of_link, link, joint, np.array(parent, dtype=np.int64))
