"""Robots of the data set as shapes to train on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stages.ingest.roboart import builder
from stages.ingest.roboart.descriptions import robot_description
from stages.ingest.roboart.motion import drive_ranges, follow, movable_joints, rest_positions
from stages.ingest.roboart.parts import rigid_parts, top_links
from stages.ingest.roboart.surface import areas, link_triangles
from stages.ingest.roboart.urdf import read_urdf
from stages.training.shapes import PosableShape

LEAST_SHARE = 0.013  # links with less of the surface join their parents, as in the data set


def robot_shape(name: str, assets: Path | None = None) -> PosableShape:
    """A robot whose joints move within their limits, a quarter turn from rest at most.

    Raises InputError as `robot_description`, or for a description that cannot be used.
    """
    found = robot_description(name, assets)
    robot = read_urdf(found.urdf_path)
    ranges = drive_ranges(robot)
    movable = movable_joints(robot, ranges)
    triangles = link_triangles(robot, top_links(robot, movable), found.urdf_path, found.mesh_dirs)
    area = np.array([areas(piece).sum() for piece in triangles])
    parts = rigid_parts(robot, area, movable, LEAST_SHARE)
    rest = rest_positions(robot, ranges)
    surface = builder.part_surface(robot, parts, triangles, rest)
    moving = np.zeros(len(robot.joints), dtype=bool)
    moving[parts.joint[1:]] = True
    drives = np.array([j for j in np.flatnonzero(moving) if robot.joints[j].mimic is None])

    def poses(positions: np.ndarray) -> np.ndarray:
        whole = np.tile(rest, (len(positions), 1))
        whole[:, drives] = positions
        return builder.part_poses(robot, parts, follow(robot, whole, moving))

    turning = np.array([robot.joints[j].kind == "revolute" for j in drives])
    return PosableShape(surface, ranges[drives], turning, poses)
