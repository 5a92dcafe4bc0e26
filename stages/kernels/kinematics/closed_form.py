"""The joint of a given kind that best explains how one part moves against another, in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import Rotation

from schemas.joints import JointKind
from stages.kernels.kinematics.tree import joint_transforms
from stages.kernels.motion.rigid_motion import move_points, rotation_vectors, rotations

FAR_TURN = np.pi / 2  # between frames that follow each other, from which on they are taken to be in no order


@dataclass(frozen=True)
class JointFit:
    """The best joint for each of several relative motions; batch axes as of the motions.

    `kind` is a number of `kinds`. `motions` are the joint's rotation vector and slide in every frame. `mean_square` is
    the mean, over frames and points, of the squared distance between where the motion and the joint take a point.
    """

    kinds: tuple[JointKind, ...]
    kind: Int64[np.ndarray, "*batch"]
    axis: Float64[np.ndarray, "*batch 3"]
    point: Float64[np.ndarray, "*batch 3"]
    motions: Float64[np.ndarray, "*batch frames 6"]
    mean_square: Float64[np.ndarray, "*batch"]

    @property
    def rms(self) -> Float64[np.ndarray, "*batch"]:
        """The distance left over, RMS."""
        return np.sqrt(self.mean_square)

    def kind_of(self, index: tuple[int, ...] = ()) -> JointKind:
        """The kind of one of the joints."""
        return self.kinds[int(self.kind[index])]

    def states_of(self, index: tuple[int, ...] = ()) -> Float64[np.ndarray, "frames size"]:
        """The states of one of the joints in all frames."""
        return self.motions[index] @ self.kind_of(index).basis(self.axis[index]).T

    def transforms(self) -> Float64[np.ndarray, "*batch frames 4 4"]:
        """The child's motion against its parent by the joint."""
        return joint_transforms(self.point[..., None, :], self.motions)

    def since(self, frame: int) -> JointFit:
        """The same joints with states of zero in a frame, where parts lie as they do in the canonical one."""
        motions = self.motions - self.motions[..., [frame], :]
        return JointFit(self.kinds, self.kind, self.axis, self.point, motions, self.mean_square)


def fit_joint(
    kinds: Sequence[JointKind], Ts: Float64[np.ndarray, "*batch frames 4 4"], p: Float64[np.ndarray, "*batch points 3"]
) -> JointFit:
    """The joint that leaves least of a sequence of relative motions, of any of some kinds (Eq. 12).

    `p` are points of the moving part, at which deviations are measured: that makes angles and lengths comparable
    without a unit. Of kinds that leave the same the first wins.
    """
    best, *others = (_fit_kind(kind, Ts, p) for kind in kinds)
    for rank, other in enumerate(others, 1):
        best = _better(best, other, np.full(other.kind.shape, rank))
    return JointFit(tuple(kinds), best.kind, best.axis, best.point, best.motions, best.mean_square)


def fit_joints(
    kinds: Sequence[tuple[JointKind, ...]],
    Ts: Float64[np.ndarray, "joints frames 4 4"],
    p: Float64[np.ndarray, "joints points 3"],
) -> JointFit:
    """`fit_joint` for several relative motions, each of which has kinds of its own to choose from."""
    known = tuple(dict.fromkeys(kind for choice in kinds for kind in choice))
    numbers = {kind: number for number, kind in enumerate(known)}
    count, frames = len(kinds), Ts.shape[1]
    kind, mean_square = np.zeros(count, dtype=np.int64), np.zeros(count)
    axis, point, motions = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, frames, 6))
    for choice in dict.fromkeys(kinds):
        own = np.array([one == choice for one in kinds])
        fit = fit_joint(choice, Ts[own], p[own])
        kind[own] = np.array([numbers[one] for one in choice])[fit.kind]
        axis[own], point[own], motions[own], mean_square[own] = fit.axis, fit.point, fit.motions, fit.mean_square
    return JointFit(known, kind, axis, point, motions, mean_square)


def nearest_point_to_origin(
    axis: Float64[np.ndarray, "*batch 3"], point: Float64[np.ndarray, "*batch 3"]
) -> Float64[np.ndarray, "*batch 3"]:
    """The point of the line through `point` along the unit `axis` that lies nearest the origin."""
    return point - axis * (point * axis).sum(axis=-1, keepdims=True)


def _better(one: JointFit, other: JointFit, kind: Int64[np.ndarray, "*batch"]) -> JointFit:
    """The fit that leaves less, joint by joint; the other's kinds are given new numbers."""
    better = other.mean_square < one.mean_square
    return JointFit(
        kinds=one.kinds,
        kind=np.where(better, kind, one.kind),
        axis=np.where(better[..., None], other.axis, one.axis),
        point=np.where(better[..., None], other.point, one.point),
        motions=np.where(better[..., None, None], other.motions, one.motions),
        mean_square=np.where(better, other.mean_square, one.mean_square),
    )


def _fit_kind(
    kind: JointKind, Ts: Float64[np.ndarray, "*batch frames 4 4"], p: Float64[np.ndarray, "*batch points 3"]
) -> JointFit:
    """The best joint of one kind.

    Its axis is the principal direction of the rotation vectors where it turns about it, or of the translations of the
    points' centre where it slides along it; where it does both, whichever of the two leaves less.
    """
    centre = p.mean(axis=-2)
    translations = move_points(Ts, centre[..., None, :]) - centre[..., None, :]
    turning = kind.turns == "axis" or not kind.has_axis
    fit = None
    if turning:
        axis = _principal_direction(rotation_vectors(Ts[..., :3, :3]))
        fit = _fit_about(kind, axis, Ts, p, centre, translations)
    if kind.slides == "axis":
        along = _fit_about(kind, _principal_direction(translations), Ts, p, centre, translations)
        fit = along if fit is None else _better(fit, along, fit.kind)
    assert fit is not None
    return fit


def _principal_direction(v: Float64[np.ndarray, "*batch frames 3"]) -> Float64[np.ndarray, "*batch 3"]:
    """The unit direction along which the vectors are longest, its greatest component positive; z when all are zero."""
    direction = np.linalg.eigh(np.swapaxes(v, -1, -2) @ v)[1][..., 2]
    greatest = np.take_along_axis(direction, np.abs(direction).argmax(axis=-1)[..., None], axis=-1)
    return np.where(greatest < 0, -direction, direction)


def _fit_about(
    kind: JointKind,
    axis: Float64[np.ndarray, "*batch 3"],
    Ts: Float64[np.ndarray, "*batch frames 4 4"],
    p: Float64[np.ndarray, "*batch points 3"],
    centre: Float64[np.ndarray, "*batch 3"],
    translations: Float64[np.ndarray, "*batch frames 3"],
) -> JointFit:
    """The best joint of one kind with a given axis direction."""
    along = axis[..., None, :]
    sliding = along * (translations * along).sum(axis=-1, keepdims=True)
    turns = _turns(kind, axis, Ts)
    # the centre moves by (R - I)(centre - point) besides the slide: least squares for point - centre
    rest = {"none": translations, "axis": translations, "all": np.zeros_like(translations)}[kind.slides]
    if kind.has_axis:
        rest = rest - sliding
    A = np.eye(3) - rotations(turns)
    normal = np.einsum("...tji,...tjk->...ik", A, A)
    if kind.has_axis:
        normal = normal + axis[..., :, None] * axis[..., None, :]  # pins the position along the axis
    damping = 1e-9 + 1e-6 * np.trace(normal, axis1=-2, axis2=-1) / 3
    right = np.einsum("...tji,...tj->...i", A, rest)
    offset = np.linalg.solve(normal + damping[..., None, None] * np.eye(3), right[..., None])[..., 0]
    point = centre + offset
    if kind.has_axis:
        point = nearest_point_to_origin(axis, point)
    slides = {"none": np.zeros_like(translations), "axis": sliding, "all": translations}[kind.slides]
    motions = np.concatenate([turns, slides], axis=-1)
    fitted = joint_transforms(point[..., None, :], motions)
    deviation = move_points(Ts[..., None, :, :] - fitted[..., None, :, :], p[..., None, :, :])
    mean_square = (deviation**2).sum(axis=-1).mean(axis=(-1, -2))
    return JointFit((kind,), np.zeros(mean_square.shape, dtype=np.int64), axis, point, motions, mean_square)


def _turns(
    kind: JointKind, axis: Float64[np.ndarray, "*batch 3"], Ts: Float64[np.ndarray, "*batch frames 4 4"]
) -> Float64[np.ndarray, "*batch frames 3"]:
    """The rotation vectors of the motions, as far as the kind allows them."""
    if kind.turns == "axis":
        return axis[..., None, :] * _angles_about(axis, Ts)[..., None]
    return rotation_vectors(Ts[..., :3, :3]) if kind.turns == "all" else np.zeros((*Ts.shape[:-2], 3))


def _angles_about(
    axis: Float64[np.ndarray, "*batch 3"], Ts: Float64[np.ndarray, "*batch frames 4 4"]
) -> Float64[np.ndarray, "*batch frames"]:
    """By how much each motion turns about the axis; without jumps of whole turns between frames."""
    quaternion = Rotation.from_matrix(Ts[..., :3, :3].reshape(-1, 3, 3)).as_quat().reshape(*Ts.shape[:-2], 4)
    angle = 2 * np.arctan2((quaternion[..., :3] * axis[..., None, :]).sum(axis=-1), quaternion[..., 3])
    return _unwrapped(np.remainder(angle + np.pi, 2 * np.pi) - np.pi)


def _unwrapped(angle: Float64[np.ndarray, "*batch frames"]) -> Float64[np.ndarray, "*batch frames"]:
    """Angles without jumps of whole turns; the frame with the least angle keeps its own.

    Frames that follow each other turn on from one to the next. Where some turn by more than `FAR_TURN`, frames are in
    no order: all angles then lie on the shortest arc that holds them.
    """
    steps = np.diff(angle, axis=-1)
    jumps = np.round(steps / (2 * np.pi))
    following = np.concatenate([np.zeros_like(angle[..., :1]), -np.cumsum(jumps, axis=-1)], axis=-1)
    far = (np.abs(steps - 2 * np.pi * jumps) > FAR_TURN).any(axis=-1, keepdims=True)
    turns = np.where(far, _turns_into_one_arc(angle), following)
    still = np.abs(angle).argmin(axis=-1)[..., None]
    return angle + 2 * np.pi * (turns - np.take_along_axis(turns, still, axis=-1))


def _turns_into_one_arc(angle: Float64[np.ndarray, "*batch frames"]) -> Float64[np.ndarray, "*batch frames"]:
    """Whole turns that bring angles within one turn of each other onto the shortest arc of the circle."""
    ahead = np.sort(angle, axis=-1)
    gaps = np.diff(ahead, axis=-1, append=ahead[..., :1] + 2 * np.pi)
    before = np.take_along_axis(ahead, gaps.argmax(axis=-1)[..., None], axis=-1)  # the widest gap follows this angle
    return np.where(angle > before, -1.0, 0.0)
