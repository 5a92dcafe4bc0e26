"""How sure a fitted model is of each joint: what the best other explanation of the same points would cost more."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64

from stages.final_fit.working import CONTACT, JOINT_SAMPLES, Fit, Frames, joint_fits, relative_motions
from stages.kernels.alignment.evidence import PLANE_NOISE, motion_cost
from stages.kernels.kinematics.articulation import Chain
from stages.kernels.kinematics.screw import fit_screw, screw_transform
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import farthest_points

FREE_STEPS = 3  # registration steps of parts without their joints
USUAL_PRICE = 30.0  # where parts have no price
REFITTED = 0.1  # share of the rise by best joints that is left when all is refitted, on robots, about
SURE = 5.0  # prices from which on a rise is not looked into further
CLEARLY_WORSE = 1.0  # spacings by which another parent is worse where a link is 1 - 1/e sure


def joint_confidence(
    fit: Fit, frames: Frames, price: float, coarseness: float = 0.0
) -> Float64[np.ndarray, "joints 3"]:
    """Three numbers in [0, 1] for each joint: `part`, `link` and `type` (KinematicModel.confidence).

    A rise of the points' costs becomes 1 - exp(-rise / price): no rise is 0, and several prices are nearly 1. A link
    is doubted where another parent would do, or where its parts' points would rather move freely than by their joints.
    Costs are those that points are labelled by (motion_cost); hypotheses are not refitted. Where coordinates lie on
    steps of `coarseness` spacings, a difference of costs or distances counts by the noise that these steps are.
    """
    chain, blur = fit.chain, _blur(coarseness)
    price = (price or USUAL_PRICE) * blur
    if len(chain.child) == 0:
        return np.zeros((0, 3))
    Ts, samples = chain.Ts(), _samples(fit, frames)
    costs = _costs(np.arange(len(fit.labels)), fit.labels, Ts, frames)
    pulled = np.maximum(_part_sums(fit, costs) - _part_sums(fit, _free_costs(fit, Ts, frames)), 0.0)
    ends = np.stack([chain.parent, chain.child])
    one_dof = np.exp(-pulled[ends].max(axis=0) / price)
    part = _certainty(_part_rises(fit, costs, Ts, samples, frames, price), price)
    link = one_dof * _certainty(_link_margins(fit, Ts, samples, frames), CLEARLY_WORSE * np.sqrt(blur))
    if coarseness > 0:  # and so blurred, no motion is told to have more degrees of freedom than one
        link = np.minimum(link, part)
    return np.stack([part, link, _certainty(_type_rises(fit, costs, Ts, samples, frames), price)], axis=1)


def _blur(coarseness: float) -> float:
    """By how much steps of so many spacings raise the squared noise of plane distances; 1 where there are none."""
    return 1.0 + (coarseness / np.sqrt(12) / PLANE_NOISE) ** 2


def _certainty(rise: Float64[np.ndarray, "joints"], price: float) -> Float64[np.ndarray, "joints"]:
    return -np.expm1(-np.maximum(rise, 0.0) / price)


def _part_rises(
    fit: Fit,
    costs: Float64[np.ndarray, "points"],
    Ts: Float64[np.ndarray, "frames parts 4 4"],
    samples: Float64[np.ndarray, "parts count 3"],
    frames: Frames,
    price: float,
) -> Float64[np.ndarray, "joints"]:
    """What points would cost more if either end of a joint were not a part of its own.

    Either it is one with the other end, or it is a piece of another, larger part that is linked to it.
    """
    chain, counts = fit.chain, np.bincount(fit.labels, minlength=fit.chain.parts)
    rises = _joining_rises(fit, costs, Ts, frames)
    rises += REFITTED * _rehanging_rises(fit, costs, Ts, samples, frames, rises < SURE * price)
    swallowed = np.where(counts[:, None] < counts, rises, np.inf)
    across = np.minimum(rises[chain.parent, chain.child], rises[chain.child, chain.parent])
    return np.minimum(across, np.minimum(swallowed[chain.parent].min(axis=1), swallowed[chain.child].min(axis=1)))


def _joining_rises(
    fit: Fit, costs: Float64[np.ndarray, "points"], Ts: Float64[np.ndarray, "frames parts 4 4"], frames: Frames
) -> Float64[np.ndarray, "parts parts"]:
    """What a part's points (rows) would cost more with the motion of another (columns); infinite if not linked."""
    parts, linked = fit.chain.parts, _linked(fit.chain)
    points, other = np.nonzero(linked[fit.labels])
    rise = _costs(points, other, Ts, frames) - costs[points]
    sums = np.bincount(fit.labels[points] * parts + other, rise, minlength=parts**2).reshape(parts, parts)
    return np.where(linked, sums, np.inf)


def _rehanging_rises(
    fit: Fit,
    costs: Float64[np.ndarray, "points"],
    Ts: Float64[np.ndarray, "frames parts 4 4"],
    samples: Float64[np.ndarray, "parts count 3"],
    frames: Frames,
    asked: Bool[np.ndarray, "parts parts"],
) -> Float64[np.ndarray, "parts parts"]:
    """What the others linked to a part (rows) would cost more if they hung on one of them (columns), by best joints.

    A round link's own points tell nothing of its turning, but what hangs on it does.
    """
    linked = _linked(fit.chain)
    part, into, other = np.nonzero(asked[:, :, None] & linked[:, None, :])
    part, into, other = (index[into != other] for index in (part, into, other))
    rises = np.zeros(asked.shape)
    if len(part):
        fits = joint_fits(Ts, into, other, samples[other])
        states = fits.states - fits.states[:, [frames.canonical_frame]]
        Ts_other = Ts[:, into] @ _joint_motions(fits.revolute, fits.axis, fits.point, states)
        case, point = np.nonzero(other[:, None] == fit.labels)
        rise = _costs(point, case, Ts_other, frames) - costs[point]
        np.add.at(rises, (part, into), np.bincount(case, rise, minlength=len(part)))
    return np.maximum(rises, 0.0)


def _joint_motions(
    revolute: Bool[np.ndarray, "joints"],
    axis: Float64[np.ndarray, "joints 3"],
    point: Float64[np.ndarray, "joints 3"],
    states: Float64[np.ndarray, "joints frames"],
) -> Float64[np.ndarray, "frames joints 4 4"]:
    """The motion of each joint's child against its parent."""
    axes, points, state = (torch.from_numpy(values)[:, None] for values in (axis, point, states))
    turns = torch.from_numpy(revolute)[:, None]
    angle, distance = torch.where(turns, state[:, 0], 0.0), torch.where(turns, 0.0, state[:, 0])
    return screw_transform(axes, points, angle, distance).transpose(0, 1).numpy()


def _linked(chain: Chain) -> Bool[np.ndarray, "parts parts"]:
    linked = np.zeros((chain.parts, chain.parts), dtype=bool)
    linked[chain.parent, chain.child] = linked[chain.child, chain.parent] = True
    return linked


def _free_costs(fit: Fit, Ts: Float64[np.ndarray, "frames parts 4 4"], frames: Frames) -> Float64[np.ndarray, "points"]:
    """Every point's cost when parts move freely: lower than with their joints where one of these is wrong."""
    points = np.arange(len(fit.labels))
    Ts_free = frames.registration.refine_groups(points, fit.labels, Ts, FREE_STEPS, frames.reach)
    return _costs(points, fit.labels, Ts_free, frames)


def _link_margins(
    fit: Fit,
    Ts: Float64[np.ndarray, "frames parts 4 4"],
    samples: Float64[np.ndarray, "parts count 3"],
    frames: Frames,
) -> Float64[np.ndarray, "joints"]:
    """By how many spacings the second best parent is worse: farther off, or two degrees of freedom away."""
    chain = fit.chain
    joint, other = np.nonzero(~chain.moves())  # whatever hangs on a child cannot be its parent
    residual = joint_fits(Ts, other, chain.child[joint], samples[chain.child[joint]]).residual / frames.noise
    distance = _gaps(fit, frames)[other, chain.child[joint]] + residual
    own = other == chain.parent[joint]
    second = np.full(len(chain.child), np.inf)
    np.minimum.at(second, joint[~own], distance[~own])
    margins = second.copy()
    margins[joint[own]] -= distance[own]
    return margins


def _gaps(fit: Fit, frames: Frames) -> Float64[np.ndarray, "parts parts"]:
    """The least distance of every two parts' points, in spacings beyond contact; unseen parts are anywhere."""
    members = [frames.p[fit.labels == part] for part in range(fit.chain.parts)]
    trees = [KDTree(p) if len(p) else None for p in members]
    gaps = np.zeros((len(members), len(members)))
    for a, tree in enumerate(trees):
        for b in range(a):
            if tree is not None and len(members[b]):
                least = nearest(tree, members[b])[0].min() / frames.noise
                gaps[a, b] = gaps[b, a] = max(least - CONTACT, 0.0)
    return gaps


def _type_rises(
    fit: Fit,
    costs: Float64[np.ndarray, "points"],
    Ts: Float64[np.ndarray, "frames parts 4 4"],
    samples: Float64[np.ndarray, "parts count 3"],
    frames: Frames,
) -> Float64[np.ndarray, "joints"]:
    """What all that a joint moves would cost more if it were the best joint of the other type."""
    chain, moves = fit.chain, fit.chain.moves()
    Ts_other = _other_motions(chain, Ts, samples, frames.canonical_frame)
    joint, point = np.nonzero(moves[:, fit.labels])
    part = fit.labels[point]
    group = joint * chain.parts + part
    used, group = np.unique(group, return_inverse=True)
    carrier, carried = np.divmod(used, chain.parts)
    Ts_moved = Ts_other[:, carrier] @ Ts[:, carried]
    rise = _costs(point, group, Ts_moved, frames) - costs[point]
    return np.bincount(joint, rise, minlength=len(chain.child))


def _other_motions(
    chain: Chain,
    Ts: Float64[np.ndarray, "frames parts 4 4"],
    samples: Float64[np.ndarray, "parts count 3"],
    canonical_frame: int,
) -> Float64[np.ndarray, "frames joints 4 4"]:
    """How what a joint moves is displaced in each frame when it becomes the best joint of the other type."""
    motions = relative_motions(Ts, chain.parent, chain.child)
    p = torch.from_numpy(samples[chain.child])
    turn, slide = fit_screw(motions, p, "revolute"), fit_screw(motions, p, "prismatic")
    turns = torch.from_numpy(chain.revolute)[:, None]
    axis, point = torch.where(turns, slide.axis, turn.axis), torch.where(turns, slide.point, turn.point)
    states = torch.where(turns, slide.states[..., 1], turn.states[..., 0])
    states = states - states[:, [canonical_frame]]
    T_parent_child = _joint_motions(~chain.revolute, axis.numpy(), point.numpy(), states.numpy())
    return Ts[:, chain.parent] @ T_parent_child @ np.linalg.inv(Ts[:, chain.child])


def _samples(fit: Fit, frames: Frames) -> Float64[np.ndarray, "parts count 3"]:
    """Well spread points of each part, at which its motion is judged; any points for a part that has none."""
    samples = []
    for part in range(fit.chain.parts):
        members = frames.p[fit.labels == part]
        members = members if len(members) else frames.p
        samples.append(members[np.resize(farthest_points(members, JOINT_SAMPLES), JOINT_SAMPLES)])
    return np.stack(samples)


def _part_sums(fit: Fit, costs: Float64[np.ndarray, "points"]) -> Float64[np.ndarray, "parts"]:
    return np.bincount(fit.labels, costs, minlength=fit.chain.parts)


def _costs(
    points: Int64[np.ndarray, "points"],
    group: Int64[np.ndarray, "points"],
    Ts: Float64[np.ndarray, "frames groups 4 4"],
    frames: Frames,
) -> Float64[np.ndarray, "points"]:
    """Chosen points' costs, each with the motion of its group."""
    return motion_cost(frames.registration, frames.p, points, group, Ts)
