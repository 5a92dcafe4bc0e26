"""A robot as rigid parts that joints move, for building sequences and for training the flow network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from jaxtyping import Bool, Float64, Int64

from schemas.config import RoboartConfig
from schemas.errors import InputError
from stages.ingest.roboart.motion import Positions, drive_ranges, follow, movable_joints, rest_positions
from stages.ingest.roboart.parts import Parts, rigid_parts, top_links
from stages.ingest.roboart.surface import Surface, areas, link_triangles, move
from stages.ingest.roboart.urdf import Robot, forward_kinematics, read_urdf

Poses = Float64[np.ndarray, "states parts 4 4"]


@dataclass(frozen=True)
class ArticulatedRobot:
    """A robot's description, its rigid parts, their surface, and the joints' ranges and rest positions."""

    robot: Robot
    parts: Parts
    surface: Surface
    link_area: Float64[np.ndarray, "links"]
    ranges: Float64[np.ndarray, "joints 2"]
    rest: Float64[np.ndarray, "joints"]

    @classmethod
    def read(cls, urdf_path: Path, mesh_dirs: Sequence[Path], config: RoboartConfig) -> Self:
        """Read a URDF. Links with less than `config.min_part_share` of the surface join their parents.

        Raises InputError for a description that cannot be read, that lacks a mesh or has one beyond
        `config.max_mesh_mib`, or that has no joint that moves a visible part.
        """
        robot = read_urdf(urdf_path)
        ranges = drive_ranges(robot)
        movable = movable_joints(robot, ranges)
        triangles = link_triangles(robot, top_links(robot, movable), urdf_path, mesh_dirs, config.max_mesh_mib)
        link_area = np.array([areas(piece).sum() for piece in triangles])
        parts = rigid_parts(robot, link_area, movable, config.min_part_share)
        if len(parts.link) < 2:
            raise InputError(
                f"{urdf_path}: found no joint that moves a visible part, expected at least one; "
                "check its joints' limits and its meshes"
            )
        rest = rest_positions(robot, ranges)
        return cls(robot, parts, _part_surface(robot, parts, triangles, rest), link_area, ranges, rest)

    @cached_property
    def moving(self) -> Bool[np.ndarray, "joints"]:
        """The joints between parts."""
        moving = np.zeros(len(self.robot.joints), dtype=bool)
        moving[self.parts.joint[1:]] = True
        return moving

    @cached_property
    def drives(self) -> Int64[np.ndarray, "drives"]:
        """The joints between parts, except those that mimic another joint."""
        return np.array([j for j in np.flatnonzero(self.moving) if self.robot.joints[j].mimic is None])

    def follow(self, positions: Positions) -> Positions:
        """Set the mimic joints in rows of joint positions to the values that follow from the others."""
        return follow(self.robot, positions, self.moving)

    def poses(self, positions: Positions) -> Poses:
        """Each part's frame in the base's frame, for rows of joint positions."""
        return forward_kinematics(self.robot, positions)[:, self.parts.link]


def _part_surface(
    robot: Robot, parts: Parts, triangles: list[np.ndarray], rest: Float64[np.ndarray, "joints"]
) -> Surface:
    """Join the links' surfaces, each in its part's frame. Joints within a part stay at rest."""
    Ts_base_link = forward_kinematics(robot, rest[None])[0]
    Ts_part_link = np.linalg.inv(Ts_base_link[parts.link[parts.part_of_link]]) @ Ts_base_link
    counts = [len(piece) for piece in triangles]
    return Surface(
        triangles=np.concatenate([move(T, piece) for T, piece in zip(Ts_part_link, triangles, strict=True)]),
        part=np.repeat(parts.part_of_link, counts),
    )
