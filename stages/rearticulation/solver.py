"""Rearticulation: the joint states that bring a few points of a model, or many, to given places (A.7)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64

from stages.rearticulation.mechanism import Mechanism

STILLNESS = 1e-7
"""Weight of a coordinate's squared change against squared distances while the best start is sought: of the poses that
reach the targets, the one nearest to its start wins."""

LEAST_NOISE, MOST_NOISE = 1e-4, 5e-3
"""What a target is known to, as a share of the diagonal, as far as the fit does not tell. Changes of a radian, or of a
diagonal, that move the targets less are undetermined: they are held to the start."""

PRESSURE = 1e-9  # least fall of the squared distances with a coordinate that is more than rounding
MOST_FRAMES = 12  # observed frames to start from: those nearest to the targets


@dataclass(frozen=True)
class Rearticulation:
    """A pose that was found: coordinates as in the mechanism, and where each part's canonical points lie then.

    `undetermined` is the share of each coordinate's change that the targets do not determine, from 0 to 1; a coordinate
    with 1 is as in the start. The targets press `bounded` coordinates against their limits.
    """

    coordinates: Float64[np.ndarray, "coordinates"]
    Ts_pose_canonical: Float64[np.ndarray, "parts 4 4"]
    undetermined: Float64[np.ndarray, "coordinates"]
    bounded: Bool[np.ndarray, "coordinates"]


def rearticulate(
    mechanism: Mechanism,
    p_source: Float64[np.ndarray, "targets 3"],
    parts: Int64[np.ndarray, "targets"],
    p_target: Float64[np.ndarray, "targets 3"],
    iterations: int = 200,
) -> Rearticulation:
    """The pose that brings points of the canonical frame, each moving with its part, closest to their targets (A.7).

    Normalised frame, radians. Least squares by Levenberg-Marquardt within the mechanism's limits, from several starts
    at once: the canonical and the nearest observed frames, and quarter turns of all joints so that large motions are
    found too. What the targets leave open stays as in the nearest of these frames. The time hardly grows with the
    number of targets.
    """
    count = mechanism.tree.size
    problem = _Problem(mechanism, *condensed(p_source, parts, p_target), STILLNESS * np.eye(count))
    starts, references = problem.starts()
    found, cost = problem.settled(starts, references, iterations)
    best = int(np.argmin(cost))
    reference = references[best, None]

    residual, jacobian = (of_pose[0] for of_pose in problem.linearised(found[best, None]))
    strength, direction = np.linalg.eigh(jacobian @ jacobian.T)
    surplus = p_target.size - np.count_nonzero(strength > LEAST_NOISE**2)
    left = residual @ residual / surplus if surplus > 0 else np.inf
    variance = np.clip(left, LEAST_NOISE**2, MOST_NOISE**2)
    weak = direction[:, strength < variance]
    hold = weak @ weak.T  # onto the changes that are held to the start; all others are free now
    problem = replace(problem, stiffness=variance * hold + 1e-6 * STILLNESS * np.eye(count))
    start = problem.feasible(found[best, None] - (found[best] - reference) @ hold, reference)
    coordinates = problem.settled(start, reference, iterations)[0]
    return Rearticulation(
        coordinates[0],
        mechanism.tree.Ts_pose_canonical(coordinates)[0],
        np.diagonal(hold),
        problem.bounded(coordinates)[0],
    )


def condensed(
    p_source: Float64[np.ndarray, "targets 3"],
    parts: Int64[np.ndarray, "targets"],
    p_target: Float64[np.ndarray, "targets 3"],
) -> tuple[Float64[np.ndarray, "rows 4"], Int64[np.ndarray, "rows"], Float64[np.ndarray, "rows 3"]]:
    """At most seven rows a part, (source times weight, weight) and target, for which every motion costs the same.

    With P~ = (P, 1) a motion T leaves |P~ T' - Q|^2 = |(P~ Q) (T, -1)'|^2, which is that of the triangle of (P~ Q)'s
    QR decomposition: exact, and without the cancellation of moments.
    """
    rows = np.concatenate([p_source, np.ones((len(p_source), 1)), p_target], axis=1)
    groups = [(part, rows[parts == part]) for part in np.unique(parts)]
    triangles = [(part, np.linalg.qr(group, mode="r") if len(group) > 7 else group) for part, group in groups]
    stacked = np.concatenate([np.zeros((0, 7)), *(rows for _, rows in triangles)])
    labels = np.repeat([part for part, _ in triangles], [len(rows) for _, rows in triangles]).astype(np.int64)
    return stacked[:, :4], labels, stacked[:, 4:]


@dataclass(frozen=True)
class _Problem:
    """The least-squares problem: squared distances of condensed targets, and the change from a reference."""

    mechanism: Mechanism
    p_source: Float64[np.ndarray, "rows 4"]
    parts: Int64[np.ndarray, "rows"]
    p_target: Float64[np.ndarray, "rows 3"]
    stiffness: Float64[np.ndarray, "coordinates coordinates"]

    def starts(self) -> tuple[Float64[np.ndarray, "starts coordinates"], Float64[np.ndarray, "starts coordinates"]]:
        """Where to start from, and what each start is drawn to.

        The canonical frame, every joint a quarter turn either way from it, and the nearest observed frames.
        """
        observed = self.mechanism.chain.states
        nearest = np.argsort(self.cost(observed, observed), kind="stable")[:MOST_FRAMES]
        references = np.concatenate([np.zeros((3, observed.shape[1])), observed[nearest]])
        starts = references.copy()
        angles = self.mechanism.tree.angles
        starts[1, angles], starts[2, angles] = np.pi / 2, -np.pi / 2
        return self.feasible(starts, references), references

    def settled(
        self,
        starts: Float64[np.ndarray, "starts coordinates"],
        references: Float64[np.ndarray, "starts coordinates"],
        iterations: int,
    ) -> tuple[Float64[np.ndarray, "starts coordinates"], Float64[np.ndarray, "starts"]]:
        """Every start followed down to where its cost is least, and that cost."""
        found, cost = starts.copy(), self.cost(starts, references)
        damping = np.full(len(starts), 1e-3)
        active = np.arange(len(starts))
        for _ in range(iterations):
            here, reference = found[active], references[active]
            trial = self.feasible(here + self.damped_step(here, reference, damping[active]), reference)
            fall = cost[active] - self.cost(trial, reference)
            better = fall > 0
            found[active[better]] = trial[better]
            cost[active] -= np.where(better, fall, 0.0)
            damping[active] = np.where(better, damping[active] / 5, damping[active] * 4).clip(1e-9, 1e9)
            active = active[np.where(better, fall > 1e-12 * cost[active], damping[active] < 1e9)]
            if len(active) == 0:
                break
        return found, cost

    def damped_step(
        self,
        coordinates: Float64[np.ndarray, "poses coordinates"],
        references: Float64[np.ndarray, "poses coordinates"],
        damping: Float64[np.ndarray, "poses"],
    ) -> Float64[np.ndarray, "poses coordinates"]:
        """The Gauss-Newton step within the limits, shortened by Marquardt's damping of the normal matrix' diagonal."""
        residual, jacobian = self.linearised(coordinates)
        gradient = (jacobian @ residual[..., None])[..., 0] + (coordinates - references) @ self.stiffness
        forbidden = self.forbidden(coordinates, gradient)
        allowed = np.eye(gradient.shape[1]) - forbidden
        normal = allowed @ (jacobian @ jacobian.transpose(0, 2, 1) + self.stiffness) @ allowed
        diagonal = np.einsum("scc->sc", normal)  # a view
        diagonal *= 1 + damping[:, None]
        step: np.ndarray = np.linalg.solve(normal + forbidden, allowed @ gradient[..., None])[..., 0]
        return -step

    def cost(
        self,
        coordinates: Float64[np.ndarray, "poses coordinates"],
        references: Float64[np.ndarray, "poses coordinates"],
    ) -> Float64[np.ndarray, "poses"]:
        offset = self.posed(self.mechanism.tree.Ts_pose_canonical(coordinates)) - self.p_target
        change = coordinates - references
        return (offset**2).sum(axis=(1, 2)) + ((change @ self.stiffness) * change).sum(axis=1)

    def linearised(
        self, coordinates: Float64[np.ndarray, "poses coordinates"]
    ) -> tuple[Float64[np.ndarray, "poses residuals"], Float64[np.ndarray, "poses coordinates residuals"]]:
        """The offsets from the targets, and how fast they grow with each coordinate."""
        tree = self.mechanism.tree
        Ts = tree.Ts_pose_canonical(coordinates)
        twists = tree.twists(coordinates, Ts)[:, :, None]
        p = self.posed(Ts)
        jacobian = np.cross(twists[..., :3], p[:, None]) + twists[..., 3:] * self.p_source[:, 3:]
        jacobian *= tree.moved_by[:, self.parts, None]
        poses, count = coordinates.shape
        residuals = self.p_target.size
        return (p - self.p_target).reshape(poses, residuals), jacobian.reshape(poses, count, residuals)

    def posed(self, Ts: Float64[np.ndarray, "poses parts 4 4"]) -> Float64[np.ndarray, "poses rows 3"]:
        """Where the source points lie, times their weights."""
        return (Ts[:, self.parts, :3] @ self.p_source[..., None])[..., 0]

    def feasible(
        self,
        coordinates: Float64[np.ndarray, "poses coordinates"],
        references: Float64[np.ndarray, "poses coordinates"],
    ) -> Float64[np.ndarray, "poses coordinates"]:
        """The same pose without whole turns more or less than the reference; within the limits where there are any."""
        mechanism = self.mechanism
        coordinates = coordinates.copy()
        angles = mechanism.tree.angles
        turning = angles[np.isinf(mechanism.upper[angles])]
        coordinates[:, turning] -= 2 * np.pi * np.round((coordinates - references)[:, turning] / (2 * np.pi))
        for ball in mechanism.tree.balls:
            turn = _nearest_turn(coordinates[:, ball], references[:, ball])
            length = np.linalg.norm(turn, axis=1, keepdims=True)
            coordinates[:, ball] = turn * np.minimum(1.0, mechanism.upper[ball] / np.maximum(length, 1e-12))
        return coordinates.clip(mechanism.lower, mechanism.upper)

    def forbidden(
        self,
        coordinates: Float64[np.ndarray, "poses coordinates"],
        gradient: Float64[np.ndarray, "poses coordinates"],
    ) -> Float64[np.ndarray, "poses coordinates coordinates"]:
        """Onto the directions in which the cost falls beyond a limit: along a coordinate, or outwards of a ball."""
        mechanism = self.mechanism
        beyond = (coordinates >= mechanism.upper) & (gradient < 0) | (coordinates <= mechanism.lower) & (gradient > 0)
        beyond[:, mechanism.tree.balls] = False
        forbidden = np.where(beyond[..., None], np.eye(beyond.shape[1]), 0.0)
        for ball in mechanism.tree.balls:
            turn = coordinates[:, ball]
            length = np.linalg.norm(turn, axis=1)
            pressed = (length >= mechanism.upper[ball[0]] * (1 - 1e-12)) & ((turn * gradient[:, ball]).sum(1) < 0)
            outwards = turn / np.maximum(length, 1e-12)[:, None] * pressed[:, None]
            forbidden[:, ball[:, None], ball] = outwards[:, :, None] * outwards[:, None]
        return forbidden

    def bounded(self, coordinates: Float64[np.ndarray, "poses coordinates"]) -> Bool[np.ndarray, "poses coordinates"]:
        """Which coordinates the targets press against their limits."""
        residual, jacobian = self.linearised(coordinates)
        gradient = (jacobian @ residual[..., None])[..., 0]
        gradient[np.abs(gradient) < PRESSURE] = 0.0
        return np.diagonal(self.forbidden(coordinates, gradient), axis1=1, axis2=2) > 0.0


def _nearest_turn(
    turn: Float64[np.ndarray, "poses 3"], reference: Float64[np.ndarray, "poses 3"]
) -> Float64[np.ndarray, "poses 3"]:
    """Of a rotation vector and the one the other way round, that which is nearer to the reference."""
    length = np.linalg.norm(turn, axis=1, keepdims=True)
    other = turn * (1 - 2 * np.pi / np.maximum(length, 1e-6))
    nearer = np.linalg.norm(other - reference, axis=1) < np.linalg.norm(turn - reference, axis=1)
    return np.where(nearer[:, None] & (length > 1e-6), other, turn)
