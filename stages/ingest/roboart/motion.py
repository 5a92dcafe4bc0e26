"""How the joints move over a sequence: seeded draws within the limits, the least penetrating one kept."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial.transform import Rotation

from schemas.config import RoboartConfig
from schemas.joints import FIXED, PRISMATIC, REVOLUTE, JointKind
from stages.ingest.roboart.urdf import Robot

# joints with less play than this are held: nobody could see them move
LEAST_RANGE = {FIXED: np.inf, REVOLUTE: np.radians(5.0), PRISMATIC: 1e-3}
# a sweep leaves some of the range between the limits unused
LARGEST_SHARE_OF_RANGE = 0.9
PRISMATIC_SHARE_OF_RANGE = (0.7, 0.9)
# two successive steps of a joint differ by this much at most, as a share of their mean
STEP_SPREAD = 0.3
# unseen states may lie this much, as a share of the swept range, beyond it on either side
NOVEL_MARGIN = 0.25
# a free base turns and shifts so much in all (the shift in diagonals), on a path bent by this share of either
BASE_TURN_DEGREES = (20.0, 40.0)
BASE_SHIFT = (0.1, 0.25)
BASE_BEND = 0.5
# the search for a motion without penetration: draws of all joints, then of one joint at a time
WHOLE_DRAWS = 6
SINGLE_REDRAWS = 40
GOOD_ENOUGH = 0.05

Positions = Float64[np.ndarray, "states joints"]


def drive_ranges(robot: Robot) -> Float64[np.ndarray, "joints 2"]:
    """The range of each joint (radians, metres) in which it and all joints that mimic it keep their limits.

    Revolute joints stay within a quarter turn of the rest pose, where a robot looks like itself.
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
    """Which joints have enough range to move."""
    least = np.array([LEAST_RANGE[joint.kind] for joint in robot.joints])
    still = [joint.mimic is not None and joint.mimic.multiplier == 0 for joint in robot.joints]
    return (ranges[:, 1] - ranges[:, 0] >= least) & ~np.array(still, dtype=bool)


def rest_positions(robot: Robot, ranges: Float64[np.ndarray, "joints 2"]) -> Float64[np.ndarray, "joints"]:
    """Where joints are held: at zero, or amid their range where zero is outside; mimic joints follow."""
    return follow(robot, _rest(ranges)[None], np.ones(len(ranges), dtype=bool))[0]


def _rest(ranges: Float64[np.ndarray, "joints 2"]) -> Float64[np.ndarray, "joints"]:
    lower, upper = ranges.T
    return np.where((lower <= 0) & (upper >= 0), 0.0, (lower + upper) / 2)


def follow(robot: Robot, positions: Positions, moving: Bool[np.ndarray, "joints"]) -> Positions:
    """`positions` with those of moving mimic joints set by their leading joint's."""
    followed = positions.copy()
    for index, joint in enumerate(robot.joints):
        if joint.mimic is not None and moving[index]:
            followed[:, index] = joint.mimic.multiplier * positions[:, joint.mimic.joint] + joint.mimic.offset
    return followed


def draw_sweep(
    kind: JointKind, limits: Float64[np.ndarray, "2"], config: RoboartConfig, rng: np.random.Generator
) -> Float64[np.ndarray, "frames"]:
    """One joint's positions: monotone, or turning back once in the later half, within the limits."""
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


def draw_unseen(
    limits: Float64[np.ndarray, "2"], swept: Float64[np.ndarray, "frames"], rng: np.random.Generator
) -> Float64[np.ndarray, "1"]:
    """One position in a joint's swept range or a little beyond it, within the limits."""
    margin = NOVEL_MARGIN * np.ptp(swept)
    return rng.uniform(max(limits[0], swept.min() - margin), min(limits[1], swept.max() + margin), size=1)


def draw_base_motion(
    path: Float64[np.ndarray, "states"], centre: Float64[np.ndarray, "3"], diagonal: float, rng: np.random.Generator
) -> Float64[np.ndarray, "states 4 4"]:
    """A smooth motion of the whole about its centre, at the shares `path` of the way; at 0 it is the identity."""

    def curve(length: float) -> Float64[np.ndarray, "states 3"]:
        """A parabola: a straight way of this length, and a detour that is greatest midway."""
        straight, detour = rng.normal(size=(2, 3))
        straight *= length / np.linalg.norm(straight)
        detour *= BASE_BEND * length / np.linalg.norm(detour)
        return path[:, None] * straight + (path * (1 - path))[:, None] * detour

    Ts = np.tile(np.eye(4), (len(path), 1, 1))
    Ts[:, :3, :3] = Rotation.from_rotvec(curve(np.radians(rng.uniform(*BASE_TURN_DEGREES)))).as_matrix()
    Ts[:, :3, 3] = curve(diagonal * rng.uniform(*BASE_SHIFT)) + centre - Ts[:, :3, :3] @ centre
    return Ts


def search(
    draw: Callable[[int], Float64[np.ndarray, "states"]],
    cost: Callable[[Positions], float],
    start: Positions,
    columns: Int64[np.ndarray, "drives"],
    rng: np.random.Generator,
) -> Positions:
    """Positions of low cost whose `columns` come from `draw(column)`; the others stay as in `start`.

    The best of a few whole draws, then redrawn joint by joint while the cost is not low enough.
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
