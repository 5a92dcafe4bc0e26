"""Building of a sequence with ground truth from a robot description (supplement C).

A seeded draw moves every active joint of the robot, steadily or to a state of its own in every frame. The base is at
rest unless it is free. Each frame is sampled independently from the posed surface, or from its visible portion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64

from schemas.config import RoboartConfig
from schemas.joints import JointKind
from schemas.sequence import TrueJoint
from stages.ingest.roboart.articulated import ArticulatedRobot, Poses
from stages.ingest.roboart.motion import Positions, draw_base_motion, draw_state, draw_sweep, draw_unseen, search
from stages.ingest.roboart.parts import Parts
from stages.ingest.roboart.penetration import penetration_score
from stages.ingest.roboart.sensor import draw_viewpoints, posed_triangles, sample_posed, sample_visible
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
) -> tuple[Frames, RawTruth]:
    """Build a sequence of any robot with a URDF, in metres and in its base link's first frame, with ground truth.

    `mesh_dirs` are the folders for package:// names. `sweep` draws one joint's positions. The states of
    `RawTruth.joints` are joint positions relative to frame 0, so a joint turns or moves its child by `states[t]`
    between frame 0 and frame t. Raises InputError for a description that cannot be read, that lacks a mesh, or that has
    no joint that moves a visible part.
    """
    articulated = ArticulatedRobot.read(urdf_path, mesh_dirs, config)
    robot, parts, surface = articulated.robot, articulated.parts, articulated.surface
    swept, unseen = joint_motion(articulated, config, rng, sweep)
    Ts_world_part, Ts_world_unseen = (articulated.poses(positions) for positions in (swept, unseen))
    if config.free_base:
        Ts_world_part, Ts_world_unseen = _free_base(surface, Ts_world_part, Ts_world_unseen, rng)
    frames, labels = _sample(surface, Ts_world_part, config, rng)
    if config.shuffled:
        order = rng.permutation(config.frames)
        swept, Ts_world_part = swept[order], Ts_world_part[order]
        frames, labels = [frames[t] for t in order], [labels[t] for t in order]
    Ts_part_first = np.linalg.inv(Ts_world_part[0])
    return frames, RawTruth(
        labels=labels,
        Ts_frame_first=Ts_world_part @ Ts_part_first,
        Ts_novel_first=Ts_world_unseen @ Ts_part_first,
        parent=parts.parent,
        part_names=tuple(robot.links[link] for link in _largest_links(parts, articulated.link_area)),
        joints=_true_joints(robot, parts, swept, Ts_world_part[0]),
    )


def _sample(
    surface: Surface, Ts_world_part: Poses, config: RoboartConfig, rng: np.random.Generator
) -> tuple[Frames, list[Int64[np.ndarray, "points"]]]:
    """Sample each frame's points and their parts, by the sensor that `config` specifies."""
    if config.viewpoints:
        p_viewpoints = draw_viewpoints(config.viewpoints, *_centre_and_diagonal(surface, Ts_world_part), rng)
        sampled = [sample_visible(surface, Ts, p_viewpoints, config.points, rng) for Ts in Ts_world_part]
    else:
        sampled = [sample_posed(surface, Ts, config.points, rng) for Ts in Ts_world_part]
    frames, labels = [points for points, _ in sampled], [part for _, part in sampled]
    if config.noise_percent:
        noise = config.noise_percent / 100 * _centre_and_diagonal(surface, Ts_world_part[:1])[1]
        frames = [points + rng.normal(0, noise, points.shape) for points in frames]
    return frames, labels


def _free_base(
    surface: Surface, Ts_world_part: Poses, Ts_world_unseen: Poses, rng: np.random.Generator
) -> tuple[Poses, Poses]:
    """Move the whole along a smooth path: the parts' poses in the frames and in the unseen states."""
    frames = len(Ts_world_part)
    path = np.concatenate([np.linspace(0, 1, frames), rng.random(len(Ts_world_unseen))])
    Ts_world_base = draw_base_motion(path, *_centre_and_diagonal(surface, Ts_world_part[:1]), rng)[:, None]
    return Ts_world_base[:frames] @ Ts_world_part, Ts_world_base[frames:] @ Ts_world_unseen


def _centre_and_diagonal(surface: Surface, Ts_world_part: Poses) -> tuple[Float64[np.ndarray, "3"], float]:
    """The centre and diagonal of the bounding box of the surface over all given states."""
    posed = [posed_triangles(surface, Ts).reshape(-1, 3) for Ts in Ts_world_part]
    low = np.min([corners.min(axis=0) for corners in posed], axis=0)
    high = np.max([corners.max(axis=0) for corners in posed], axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low))


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
