"""Building of a sequence with ground truth from a robot description (supplement C).

A seeded draw moves every active joint of the robot, steadily or to a state of its own in every frame. The base is at
rest unless it is free. Each frame is sampled independently, and may have coordinates of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from schemas.config import RoboartConfig
from schemas.joints import JointKind
from schemas.sequence import TrueJoint
from stages.ingest.roboart.articulated import ArticulatedRobot, Poses
from stages.ingest.roboart.motion import (
    Positions,
    draw_base_motion,
    draw_coordinates,
    draw_state,
    draw_sweep,
    draw_unseen,
    search,
)
from stages.ingest.roboart.parts import Parts
from stages.ingest.roboart.penetration import penetration_score
from stages.ingest.roboart.scans import scan_states
from stages.ingest.roboart.sensor import centre_and_diagonal
from stages.ingest.roboart.surface import Surface
from stages.ingest.roboart.urdf import Robot
from stages.ingest.truth import RawTruth

Frames = list[Float64[np.ndarray, "points 3"]]
# (kind of joint, limits, settings, generator) -> positions (frames,)
Sweep = Callable[[JointKind, Float64[np.ndarray, "2"], RoboartConfig, np.random.Generator], np.ndarray]


def build_from_urdf(
    urdf_path: Path,
    mesh_dirs: Sequence[Path],
    config: RoboartConfig,
    rng: np.random.Generator,
    sweep: Sweep = draw_sweep,
) -> tuple[Frames, RawTruth, Float64[np.ndarray, "frames cameras 3"] | None]:
    """Build a sequence of any robot with a URDF, in metres: its frames, ground truth, and viewpoints where known.

    Coordinates are those of the base link's first frame, unless each frame has its own. `mesh_dirs` are the folders for
    package:// names. `sweep` draws one joint's positions. The states of `RawTruth.joints` are joint positions relative
    to frame 0, so a joint turns or moves its child by `states[t]` between frame 0 and frame t. Raises InputError for a
    description that cannot be read, that lacks a mesh, or that has no joint that moves a visible part.
    """
    articulated = ArticulatedRobot.read(urdf_path, mesh_dirs, config)
    robot, parts, surface = articulated.robot, articulated.parts, articulated.surface
    swept, unseen = joint_motion(articulated, config, rng, sweep)
    Ts_world_part, Ts_world_unseen = (articulated.poses(positions) for positions in (swept, unseen))
    if config.free_base:
        Ts_world_part, Ts_world_unseen = _free_base(surface, Ts_world_part, Ts_world_unseen, rng)
    scans = scan_states(surface, Ts_world_part, config, rng)
    (arranging,) = rng.spawn(1)  # so that neither order nor coordinates depend on how the frames are sampled
    if config.shuffled:
        order = arranging.permutation(config.frames)
        swept, Ts_world_part, scans = swept[order], Ts_world_part[order], [scans[t] for t in order]
    if config.coordinates != "shared":
        size = centre_and_diagonal(surface, Ts_world_part)
        Ts_own_world = draw_coordinates(config.frames, config.coordinates == "upright", *size, arranging)
        scans = [scan.moved(T) for scan, T in zip(scans, Ts_own_world, strict=True)]
        Ts_world_part, Ts_world_unseen = Ts_own_world[:, None] @ Ts_world_part, Ts_own_world[0] @ Ts_world_unseen
    Ts_part_first = np.linalg.inv(Ts_world_part[0])
    truth = RawTruth(
        labels=[scan.part for scan in scans],
        Ts_frame_first=Ts_world_part @ Ts_part_first,
        Ts_novel_first=Ts_world_unseen @ Ts_part_first,
        parent=parts.parent,
        part_names=tuple(robot.links[link] for link in _largest_links(parts, articulated.link_area)),
        joints=_true_joints(robot, parts, swept, Ts_world_part[0]),
        own_coordinates=config.coordinates != "shared",
    )
    views = [scan.p_viewpoints for scan in scans if scan.p_viewpoints is not None and config.known_viewpoints]
    return [scan.points for scan in scans], truth, np.stack(views) if views else None


def _free_base(
    surface: Surface, Ts_world_part: Poses, Ts_world_unseen: Poses, rng: np.random.Generator
) -> tuple[Poses, Poses]:
    """Move the whole along a smooth path: the parts' poses in the frames and in the unseen states."""
    frames = len(Ts_world_part)
    path = np.concatenate([np.linspace(0, 1, frames), rng.random(len(Ts_world_unseen))])
    Ts_world_base = draw_base_motion(path, *centre_and_diagonal(surface, Ts_world_part[:1]), rng)[:, None]
    return Ts_world_base[:frames] @ Ts_world_part, Ts_world_base[frames:] @ Ts_world_unseen


def joint_motion(
    articulated: ArticulatedRobot, config: RoboartConfig, rng: np.random.Generator, sweep: Sweep = draw_sweep
) -> tuple[Positions, Positions]:
    """Draw joint positions of the frames, by `sweep` or each frame's on its own, and of the unseen states."""
    robot, ranges, rest = articulated.robot, articulated.ranges, articulated.rest
    score = penetration_score(articulated.surface, articulated.poses(rest[None])[0], rng)

    def penetration(positions: Positions) -> float:
        return score(articulated.poses(articulated.follow(positions)))

    def swept_by(joint: int) -> np.ndarray:
        return sweep(robot.joints[joint].kind, ranges[joint], config, rng)

    def anywhere(joint: int) -> np.ndarray:
        return draw_state(ranges[joint], rng)

    def unseen(joint: int) -> np.ndarray:
        return draw_unseen(ranges[joint], swept[:, joint], rng)

    def lowest(draw: Callable[[int], np.ndarray], states: int) -> Positions:
        return search(draw, penetration, np.tile(rest, (states, 1)), articulated.drives, rng)

    if config.motion == "states":
        swept = np.concatenate([lowest(anywhere, 1) for _ in range(config.frames)])
    else:
        swept = lowest(swept_by, config.frames)
    novel = [lowest(unseen, 1) for _ in range(config.novel_states)]
    return (
        articulated.follow(swept),
        articulated.follow(np.concatenate([np.empty((0, len(rest))), *novel])),
    )


def _largest_links(parts: Parts, link_area: Float64[np.ndarray, "links"]) -> list[int]:
    """The link with the largest surface of each part, after which a reader would name the part."""
    return [
        int(max(np.flatnonzero(parts.part_of_link == part), key=lambda link: link_area[link]))
        for part in range(len(parts.link))
    ]


def _true_joints(
    robot: Robot, parts: Parts, positions: Positions, Ts_world_part: Float64[np.ndarray, "parts 4 4"]
) -> tuple[TrueJoint, ...]:
    """The joints that move parts, posed in frame 0 by `Ts_world_part`."""
    found = []
    for part in range(1, len(parts.link)):
        index = int(parts.joint[part])
        joint, T_world_joint = robot.joints[index], Ts_world_part[part]  # a joint's frame moves with its child
        found.append(
            TrueJoint(
                name=joint.name,
                parent=int(parts.parent[part]),
                child=part,
                type=joint.kind.name,
                axis=tuple((T_world_joint[:3, :3] @ joint.axis).tolist()),
                point=tuple(T_world_joint[:3, 3].tolist()),
                states=tuple((positions[:, index] - positions[0, index]).tolist()),
            )
        )
    return tuple(found)
