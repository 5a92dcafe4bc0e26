"""Robots of the data set as training shapes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schemas.config import RoboartConfig
from schemas.joints import REVOLUTE
from stages.flow.training.shapes import PosableShape
from stages.ingest.roboart.articulated import ArticulatedRobot, Poses
from stages.ingest.roboart.descriptions import robot_description


def robot_shape(name: str, assets: Path | None = None) -> PosableShape:
    """A robot with the parts of the data set. Its joints keep their limits and turn at most a quarter turn from rest.

    Raises InputError as `robot_description` does, or for a description that cannot be used.
    """
    found = robot_description(name, assets)
    articulated = ArticulatedRobot.read(found.urdf_path, found.mesh_dirs, RoboartConfig())
    drives = articulated.drives

    def poses(positions: np.ndarray) -> Poses:
        whole = np.tile(articulated.rest, (len(positions), 1))
        whole[:, drives] = positions
        return articulated.poses(articulated.follow(whole))

    turning = np.array([articulated.robot.joints[j].kind == REVOLUTE for j in drives])
    return PosableShape(articulated.surface, articulated.ranges[drives], turning, poses)
