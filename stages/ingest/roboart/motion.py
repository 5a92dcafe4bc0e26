"""Motion of the joints over a sequence: seeded draws within the limits, of which the least penetrating is used."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial.transform import Rotation

from schemas.config import RoboartConfig
from schemas.joints import FIXED, PRISMATIC, REVOLUTE, JointKind
from stages.ingest.roboart.urdf import Robot
from stages.kernels.motion.rigid_motion import from_parts

# joints with a smaller range are held, since their motion could not be observed
LEAST_RANGE = {FIXED: np.inf, REVOLUTE: np.radians(5.0), PRISMATIC: 1e-3}
# a sweep uses only a share of the range between the limits
LARGEST_SHARE_OF_RANGE = 0.9
PRISMATIC_SHARE_OF_RANGE = (0.7, 0.9)
# successive steps of a joint differ by at most this share of their mean
STEP_SPREAD = 0.3
# unseen states may lie beyond the swept range by this share of it, on either side
NOVEL_MARGIN = 0.25
# total turn and shift (in diagonals) of a free base, and the bend of its path as a share of either
BASE_TURN_DEGREES = (20.0, 40.0)
BASE_SHIFT = (0.1, 0.25)
BASE_BEND = 0.5
# frames with coordinates of their own: greatest tilt, and greatest shift along each axis in diagonals
OWN_TILT_DEGREES = 5.0
OWN_SHIFT = 1.0
# search for a motion without penetration: draws of all joints, then redraws of one joint at a time
WHOLE_DRAWS = 6
SINGLE_REDRAWS = 40
GOOD_ENOUGH = 0.05

Positions = Float64[np.ndarray, "states joints"]


def drive_ranges(robot: Robot) -> Float64[np.ndarray, "joints 2"]:
    """The range of each joint (radians, metres) in which it and all joints that mimic it keep their limits.

    Revolute joints stay within a quarter turn of the rest pose, so that a robot keeps its typical look.
    """
    ranges = np.array([[joint.lower, joint.upper] for joint in robot.joints]).reshape(-1, 2)
    for joint in robot.joints:
        if joint.mimic is None or joint.mimic.multiplier == 0:
            continue
        ends = (np.array([joint.lower, joint.upper]) - joint.mimic.offset) / joint.mimic.multiplier
        lead = ranges[joint.mimic.joint]
        lead[:] = max(lead[0], ends.min()), min(lead[1], ends.max())
    rest = _rest(ranges)
    revolute = np.array([joint.kind == REVOLUTE for joint in robot.joints], dtype=bool)
    ranges[revolute, 0] = np.maximum(ranges[revolute, 0], rest[revolute] - np.pi / 2)
    ranges[revolute, 1] = np.minimum(ranges[revolute, 1], rest[revolute] + np.pi / 2)
    return ranges


def movable_joints(robot: Robot, ranges: Float64[np.ndarray, "joints 2"]) -> Bool[np.ndarray, "joints"]:
    """Which joints have a range large enough to move."""
    least = np.array([LEAST_RANGE[joint.kind] for joint in robot.joints])
    still = [joint.mimic is not None and joint.mimic.multiplier == 0 for joint in robot.joints]
    return (ranges[:, 1] - ranges[:, 0] >= least) & ~np.array(still, dtype=bool)


def rest_positions(robot: Robot, ranges: Float64[np.ndarray, "joints 2"]) -> Float64[np.ndarray, "joints"]:
    """The rest positions: zero, or the middle of the range if that excludes zero. Mimic joints follow."""
    return follow(robot, _rest(ranges)[None], np.ones(len(ranges), dtype=bool))[0]


def _rest(ranges: Float64[np.ndarray, "joints 2"]) -> Float64[np.ndarray, "joints"]:
    lower, upper = ranges.T
    return np.where((lower <= 0) & (upper >= 0), 0.0, (lower + upper) / 2)


def follow(robot: Robot, positions: Positions, moving: Bool[np.ndarray, "joints"]) -> Positions:
    """Set the positions of moving mimic joints from those of their leading joints."""
    followed = positions.copy()
    for index, joint in enumerate(robot.joints):
        if joint.mimic is not None and moving[index]:
            followed[:, index] = joint.mimic.multiplier * positions[:, joint.mimic.joint] + joint.mimic.offset
    return followed


def draw_sweep(
    kind: JointKind, limits: Float64[np.ndarray, "2"], config: RoboartConfig, rng: np.random.Generator
) -> Float64[np.ndarray, "frames"]:
    """Draw one joint's positions within the limits: monotone, or reversing once in the later half."""
    lower, upper = limits
    steps = rng.uniform(1 - STEP_SPREAD, 1 + STEP_SPREAD, config.frames - 1)
    turn = rng.integers(config.frames // 2, config.frames) if rng.random() < 0.5 else config.frames
    steps[turn:] *= -1
    path = np.concatenate([[0.0], np.cumsum(steps)]) * rng.choice([-1.0, 1.0])
    if kind == PRISMATIC:
        path *= rng.uniform(*PRISMATIC_SHARE_OF_RANGE) * (upper - lower) / np.ptp(path)
    else:
        path *= np.radians(rng.uniform(*config.sweep_degrees)) / np.abs(steps).sum()
        path *= min(1.0, LARGEST_SHARE_OF_RANGE * (upper - lower) / np.ptp(path))
    return path + rng.uniform(lower - path.min(), upper - path.max())


def draw_state(limits: Float64[np.ndarray, "2"], rng: np.random.Generator) -> Float64[np.ndarray, "1"]:
    """Draw one position of a joint anywhere within its limits."""
    return rng.uniform(limits[0], limits[1], size=1)


def draw_unseen(
    limits: Float64[np.ndarray, "2"], swept: Float64[np.ndarray, "frames"], rng: np.random.Generator
) -> Float64[np.ndarray, "1"]:
    """Draw one position in a joint's swept range or slightly beyond it, within the limits."""
    margin = NOVEL_MARGIN * np.ptp(swept)
    return rng.uniform(max(limits[0], swept.min() - margin), min(limits[1], swept.max() + margin), size=1)


def draw_base_motion(
    path: Float64[np.ndarray, "states"], centre: Float64[np.ndarray, "3"], diagonal: float, rng: np.random.Generator
) -> Float64[np.ndarray, "states 4 4"]:
    """Draw a smooth motion of the whole about its centre, at the shares `path` of the way. At 0 it is the identity."""

    def curve(length: float) -> Float64[np.ndarray, "states 3"]:
        """A parabola: a straight path of this length, plus a detour that is largest in the middle."""
        straight, detour = rng.normal(size=(2, 3))
        straight *= length / np.linalg.norm(straight)
        detour *= BASE_BEND * length / np.linalg.norm(detour)
        return path[:, None] * straight + (path * (1 - path))[:, None] * detour

    Ts = np.tile(np.eye(4), (len(path), 1, 1))
    Ts[:, :3, :3] = Rotation.from_rotvec(curve(np.radians(rng.uniform(*BASE_TURN_DEGREES)))).as_matrix()
    Ts[:, :3, 3] = curve(diagonal * rng.uniform(*BASE_SHIFT)) + centre - Ts[:, :3, :3] @ centre
    return Ts


def draw_coordinates(
    frames: int, upright: bool, centre: Float64[np.ndarray, "3"], diagonal: float, rng: np.random.Generator
) -> Float64[np.ndarray, "frames 4 4"]:
    """Draw T_own_world of frames with coordinates of their own: turned about the object's centre, then shifted.

    Upright ones turn by any angle about the vertical and tilt a little. Others turn by any angle about any axis.
    """
    if upright:
        yaw, heading = rng.uniform(-np.pi, np.pi, (2, frames))
        level = np.stack([np.cos(heading), np.sin(heading), np.zeros(frames)], axis=1)
        tilt = np.radians(rng.uniform(0, OWN_TILT_DEGREES, frames))
        turns = Rotation.from_rotvec(tilt[:, None] * level) * Rotation.from_rotvec(yaw[:, None] * [0.0, 0.0, 1.0])
    else:
        turns = Rotation.from_quat(rng.normal(size=(frames, 4)))  # uniform over all rotations
    R = turns.as_matrix()
    return from_parts(R, centre + OWN_SHIFT * diagonal * rng.uniform(-1, 1, (frames, 3)) - R @ centre)


def search(
    draw: Callable[[int], Float64[np.ndarray, "states"]],
    cost: Callable[[Positions], float],
    start: Positions,
    columns: Int64[np.ndarray, "drives"],
    rng: np.random.Generator,
) -> Positions:
    """Search for positions of low cost. Their `columns` come from `draw(column)`; the others stay as in `start`.

    The search takes the best of a few whole draws, then redraws single joints until the cost is low enough.
    """
    candidates = []
    for _ in range(WHOLE_DRAWS):
        positions = start.copy()
        for column in columns:
            positions[:, column] = draw(column)
        candidates.append((cost(positions), positions))
    lowest, best = min(candidates, key=lambda candidate: candidate[0])
    for _ in range(SINGLE_REDRAWS):
        if lowest <= GOOD_ENOUGH:
            break
        positions = best.copy()
        column = rng.choice(columns)
        positions[:, column] = draw(column)
        if (found := cost(positions)) < lowest:
            lowest, best = found, positions
    return best
