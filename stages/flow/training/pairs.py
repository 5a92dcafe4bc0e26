"""Pairs of clouds of one shape in two poses, with their true correspondences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from schemas.config import TrainFlowConfig
from stages.flow.network.geometry import CloudGeometry, cloud_geometry
from stages.flow.training.shapes import PosableShape
from stages.ingest.roboart.articulated import Poses
from stages.ingest.roboart.sensor import draw_viewpoints, sample_posed, sample_visible
from stages.ingest.roboart.surface import Surface
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, nearest

VISIBLE_SHARE = 0.2  # of pairs that are sampled only where some viewpoints see the surface
VIEWPOINTS = (2, 4)
STILL_SHARE = (0.0, 0.7)  # of joints that do not move in a pair
STEP_SPREAD = (0.4, 1.2)  # a joint's motion, relative to the pair's step
LARGEST_NOISE = 0.004  # standard deviation, in diagonals
SCALES = (0.75, 1.15)  # range of the diagonal of a pair's clouds
HOLE_SHARE, HOLE_RADIUS = 0.3, (0.03, 0.12)  # share of clouds with holes, and the holes' radius in diagonals
FAR = 0.025  # points without a counterpart within this distance, in diagonals, have no label


@dataclass(frozen=True)
class Pair:
    """Two clouds as the network's input. Fine point i of one corresponds to `match[i]` of the other if `known[i]`."""

    first: CloudGeometry
    second: CloudGeometry
    match_first: Int64[np.ndarray, "fine"]
    match_second: Int64[np.ndarray, "fine"]
    known_first: Bool[np.ndarray, "fine"]
    known_second: Bool[np.ndarray, "fine"]


def make_pair(shape: PosableShape, config: TrainFlowConfig, rng: np.random.Generator) -> Pair:
    """Draw two poses, sample each independently, and match them by the true motion (the label of A.1)."""
    Ts = shape.poses(draw_positions(shape, config, rng))
    clouds, labels = _sample(shape.surface, Ts, config.points, rng)
    low, high = np.min([p.min(axis=0) for p in clouds], axis=0), np.max([p.max(axis=0) for p in clouds], axis=0)
    diagonal = float(np.linalg.norm(high - low))
    scale = rng.uniform(*SCALES) / diagonal
    torn = [_tear(p, diagonal, rng) for p in clouds]
    labels = [label[kept] for label, kept in zip(labels, torn, strict=True)]
    clouds = [p[kept] for p, kept in zip(clouds, torn, strict=True)]
    noise = rng.uniform(0, LARGEST_NOISE) * diagonal if rng.random() < 0.5 else 0.0
    noisy = [p + rng.normal(0, noise, p.shape) if noise else p for p in clouds]
    geometries = [cloud_geometry(p * scale, all_points=False) for p in noisy]
    # find the fine points in the clouds without noise, to get their places on the surface
    fine = [
        nearest(KDTree((p - p.mean(axis=0)) * scale), geometry.points.astype(np.float64))[1]
        for p, geometry in zip(noisy, geometries, strict=True)
    ]
    on_surface = [p[index] for p, index in zip(clouds, fine, strict=True)]
    part = [label[index] for label, index in zip(labels, fine, strict=True)]
    matches, known = [], []
    for a, b in ((0, 1), (1, 0)):
        T_there_here = Ts[b] @ np.linalg.inv(Ts[a])
        moved = move_points(T_there_here[part[a]], on_surface[a])
        distance, index = nearest(KDTree(on_surface[b]), moved)
        matches.append(index)
        known.append((distance < FAR * diagonal) & (part[b][index] == part[a]))
    return Pair(geometries[0], geometries[1], matches[0], matches[1], known[0], known[1])


def draw_positions(
    shape: PosableShape, config: TrainFlowConfig, rng: np.random.Generator
) -> Float64[np.ndarray, "2 joints"]:
    """Draw joint positions of two frames: any position, then a step from it, reversed where it would pass a limit."""
    low, high = shape.ranges.T
    width = high - low
    here = rng.uniform(low, high)
    degrees = np.exp(rng.uniform(*np.log(config.step_degrees)))
    step = np.where(shape.turning, np.radians(degrees), degrees / config.step_degrees[1] * width)
    step = step * rng.uniform(*STEP_SPREAD, len(width)) * rng.choice([-1.0, 1.0], len(width))
    step[rng.random(len(width)) < rng.uniform(*STILL_SHARE)] = 0.0
    there = here + step
    there = np.where((there < low) | (there > high), here - step, there)
    return np.stack([here, np.clip(there, low, high)])


def _sample(
    surface: Surface, Ts: Poses, points: int, rng: np.random.Generator
) -> tuple[list[Float64[np.ndarray, "points 3"]], list[Int64[np.ndarray, "points"]]]:
    if rng.random() >= VISIBLE_SHARE:
        sampled = [sample_posed(surface, pose, points, rng) for pose in Ts]
    else:
        whole = np.concatenate([sample_posed(surface, pose, 256, rng)[0] for pose in Ts])
        centre, diagonal = whole.mean(axis=0), float(np.linalg.norm(np.ptp(whole, axis=0)))
        p_viewpoints = draw_viewpoints(int(rng.integers(*VIEWPOINTS, endpoint=True)), centre, diagonal, rng)
        sampled = [sample_visible(surface, pose, p_viewpoints, points, rng) for pose in Ts]
    return [p for p, _ in sampled], [label for _, label in sampled]


def _tear(
    points: Float64[np.ndarray, "points 3"], diagonal: float, rng: np.random.Generator
) -> Bool[np.ndarray, "points"]:
    """Cut holes into a cloud: which points remain."""
    kept = np.ones(len(points), dtype=bool)
    if rng.random() < HOLE_SHARE:
        for centre in points[rng.integers(len(points), size=rng.integers(1, 4))]:
            kept &= np.linalg.norm(points - centre, axis=1) > rng.uniform(*HOLE_RADIUS) * diagonal
    return kept if kept.sum() > len(points) / 2 else np.ones(len(points), dtype=bool)
