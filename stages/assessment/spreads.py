"""How exactly each joint's axis is known, from the normal equations of the final fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from schemas.assessment import Spread
from schemas.kinematic import CONFIDENCES
from stages.final_fit.working import Fit, Frames
from stages.kernels.alignment.registration import Pairs, group_means, robust_weight
from stages.kernels.kinematics.chain import jacobians, normal_blocks
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points

# By how much errors exceed those that residuals show, as calibrated by benchmarks/verdict.py: by SCALE where frames are
# many. Few frames hardly show the errors that all points of a frame have in common.
SCALE, MANY_FRAMES = 1.2, 11.0
PART, TYPE = (CONFIDENCES.index(name) for name in ("part", "type"))
PATCH = 40  # points whose errors are taken for one: neighbours share what is wrong with their surface
USUAL = 50.0  # pairs of the whole model's residual variance that each part's is mixed with
ANY_ANGLE = np.pi  # standard deviation of a joint's angle before anything was seen, in radians
ANY_DIRECTION, ANY_PLACE = 1.0, 0.5  # the same of a component of an axis' direction (radians) and place (diagonals)


def joint_spreads(
    fit: Fit, frames: Frames, confidence: Float64[np.ndarray, "joints 3"] | None = None
) -> tuple[Spread, ...]:
    """The spread of each joint at its point: of its axis' direction, and of its place across the axis.

    Both are root mean squares. An axis is as uncertain as its joint's parts and kind are (`confidence`): a round link
    that moves like its neighbour as far as one sees may have any.
    """
    tree = fit.chain.tree
    if not len(tree.child):
        return ()
    scale = SCALE * np.sqrt(1 + MANY_FRAMES / len(frames.registration.others))
    covariances = axis_covariances(fit, frames, scale)
    sure = np.ones(len(tree.child)) if confidence is None else confidence[:, [PART, TYPE]].min(axis=1)
    spreads = []
    for kind, axis, covariance, unsure in zip(tree.kinds, tree.axis, covariances, 1 - sure, strict=True):
        across = np.eye(3) - np.outer(axis, axis) if kind.has_axis else np.eye(3)
        any_spread = unsure * np.sqrt(np.trace(across)) * np.array([ANY_DIRECTION, ANY_PLACE])
        turn, slide = (np.sqrt(np.trace(across @ covariance[i, i])) for i in (slice(3), slice(3, 6)))
        direction, place = np.hypot([turn, slide], any_spread)
        spreads.append(
            Spread(
                direction=min(float(direction), np.pi / 2) if kind.has_axis else None,
                place=min(float(place), 1.0) if kind.turns != "none" else None,
            )
        )
    return tuple(spreads)


@dataclass(frozen=True)
class PlaneEquations:
    """What plane distances say of the parts' motions: their normal matrix, and the pull of each patch of points.

    Twists turn about `centres`: angles in radians, lengths in spacings. Both are in units of each part's residual
    variance. `part` is that of each patch.
    """

    hessian: Float64[np.ndarray, "frames parts 6 6"]
    pull: Float64[np.ndarray, "frames patches 6"]
    part: Int64[np.ndarray, "patches"]
    centres: Float64[np.ndarray, "frames parts 3"]


def axis_covariances(fit: Fit, frames: Frames, scale: float) -> Float64[np.ndarray, "joints 6 6"]:
    """Covariance of a small rigid motion of each axis about its joint's point; radians and diagonals.

    With the normal matrix N of the axes, from which the states are eliminated, it is N^-1 M N^-1. M is N itself, as of
    independent errors, plus the products of the pulls that should add up to nothing: of each patch of points, which err
    together; of each frame; and of all, as the fit ends before its last step. Errors are taken for `scale` times as
    large. Distances along the surface say nothing, since points are sampled anew in each frame. What nothing is known
    of is as uncertain as all that is possible.
    """
    equations = plane_equations(fit, frames)
    chain, spacing = fit.chain, frames.spacing
    tree, others = chain.tree, frames.registration.others
    joints = len(tree.child)
    own, shared = (jacobian[others] for jacobian in jacobians(chain, equations.centres, spacing))
    hessian = equations.hessian[others] / scale**2
    A, B, C = normal_blocks(own, shared, hessian)
    A += np.diag(np.where(tree.basis[:, :3].any(axis=1), 1 / ANY_ANGLE**2, spacing**2))
    C += np.diag(np.tile(np.repeat([1 / ANY_DIRECTION**2, (spacing / ANY_PLACE) ** 2], 3), joints))
    follows = np.linalg.solve(A, B)
    covariance = np.linalg.inv(C - np.einsum("tom,ton->mn", B, follows))
    of_patches, of_frames = np.zeros((len(equations.part), 6 * joints)), np.zeros((len(others), 6 * joints))
    for slot, t in enumerate(others):
        left = shared[slot] - own[slot] @ follows[slot]  # parts 6 shared: how axes move parts when states give way
        pulls = np.einsum("pim,pi->pm", left[equations.part], equations.pull[t])
        of_patches += pulls
        of_frames[slot] = pulls.sum(axis=0)
    pulls = np.concatenate([of_patches, of_frames, of_frames.sum(axis=0, keepdims=True)])
    steps = pulls @ covariance / scale
    blocks = (covariance + steps.T @ steps).reshape(joints, 6, joints, 6)
    joint, unit = np.arange(joints), np.repeat([1.0, spacing], 3)
    return blocks[joint, :, joint] * unit[:, None] * unit


def plane_equations(fit: Fit, frames: Frames) -> PlaneEquations:
    """Pairs of model and frames, weighted as the final fit weights them, without their distances along the surface."""
    registration, labels, Ts = frames.registration, fit.labels, fit.chain.Ts
    parts = fit.chain.parts
    patch, part = _patches(frames.p, labels, parts)
    own_centres = group_means(frames.p, labels, parts)
    centres = np.stack([move_points(T, own_centres) for T in Ts])
    hessian, pull = np.zeros((len(Ts), parts, 6, 6)), np.zeros((len(Ts), len(part), 6))
    squares, weights = np.zeros(parts), np.zeros(parts)
    for t in registration.others:
        pairs = registration.pairs(t, labels, Ts)
        of = labels[pairs.source]
        weight = registration.shares[t] * robust_weight(pairs.distance, frames.reach) * pairs.tells
        along, residual = _plane_rows(pairs, (pairs.p - centres[t, of]) / frames.spacing)
        weighted = weight[:, None] * along
        for k in range(parts):
            hessian[t, k] = weighted[of == k].T @ along[of == k]
        for i, column in enumerate(weighted.T):
            pull[t, :, i] = np.bincount(patch[pairs.source], column * residual, minlength=len(part))
        squares += np.bincount(of, weight * residual**2, minlength=parts)
        weights += np.bincount(of, weight, minlength=parts)
    usual = squares.sum() / max(weights.sum(), 1e-12)
    variance = (squares + USUAL * usual) / (weights + USUAL) + 1e-12
    return PlaneEquations(hessian / variance[:, None, None], pull / variance[part, None], part, centres)


def _plane_rows(
    pairs: Pairs, arms: Float64[np.ndarray, "pairs 3"]
) -> tuple[Float64[np.ndarray, "pairs 6"], Float64[np.ndarray, "pairs"]]:
    """d(plane distance)/d(twist) of each pair, and the plane distance, in spacings."""
    along = np.concatenate([np.cross(arms, pairs.normal), pairs.normal], axis=1)
    return along, np.einsum("ni,ni->n", pairs.normal, pairs.offset)


def _patches(
    p: Float64[np.ndarray, "points 3"], labels: Int64[np.ndarray, "points"], parts: int
) -> tuple[Int64[np.ndarray, "points"], Int64[np.ndarray, "patches"]]:
    """The patch of each point, about `PATCH` neighbours of one part, and the part of each patch."""
    patch = np.zeros(len(p), dtype=np.int64)
    part: list[int] = []
    for k in range(parts):
        own = np.flatnonzero(labels == k)
        if len(own):
            seeds = p[own][farthest_points(p[own], max(1, round(len(own) / PATCH)))]
            patch[own] = len(part) + nearest(KDTree(seeds), p[own])[1]
            part += [k] * len(seeds)
    return patch, np.array(part, dtype=np.int64)
