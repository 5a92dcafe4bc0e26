"""Posing: a fitted model brought to given joint states, or to where given points of it are to lie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64

from schemas.artifact import GREATEST
from schemas.errors import LONGEST_FIELD, LONGEST_NAME, InputError, quoted, shortened
from schemas.model_file import ModelJoint, Result, are
from schemas.pose import Pose, State, TargetFit, Transform
from stages.final_fit.working import root_moves
from stages.kernels.kinematics.chain import Chain, Joint
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.normalisation import Normalisation
from stages.rearticulation.mechanism import Mechanism
from stages.rearticulation.solver import rearticulate

FARTHEST = 0.05  # of a source point from the canonical points, as a share of the diagonal
OUT_OF_REACH = 100.0  # of a target from its source point, in diagonals: it is in other units, or of another place
UNDETERMINED = 0.05  # share of a coordinate's change that targets leave open, from which on its joint is undetermined
MOST_LISTED = 12  # joints in a message
ROUNDING = 1e-9  # by which a state may be beyond a limit


@dataclass(frozen=True)
class PosedModel:
    """A pose, and where each part's canonical points lie in it, in the input's units."""

    pose: Pose
    Ts_pose_canonical: Float64[np.ndarray, "parts 4 4"]

    def points(self, result: Result) -> Float64[np.ndarray, "points 3"]:
        """Where the canonical points lie."""
        return move_points(self.Ts_pose_canonical[result.labels], result.canonical_points.astype(np.float64))


def pose_by_states(
    result: Result, states: Mapping[str, State], T_pose_root: Float64[np.ndarray, "4 4"], limits: bool = True
) -> PosedModel:
    """The model at given states; a joint that is not named stays as in the canonical frame.

    Raises InputError for a joint that the model does not have, a state of another kind than the joint's, and with
    `limits` for one outside them.
    """
    joints = {joint.name: joint for joint in result.model.joints}
    for name, state in states.items():
        if name not in joints:
            raise InputError(f"found the joint {quoted(name)}, expected one of {_listed(list(joints))}; rename it")
        _check_state(joints[name], state, limits)
    space = Normalisation.of(result.canonical_points)
    tree = _chain(result, space, free_base=False).tree
    coordinates = np.zeros(tree.size)
    for index, joint in enumerate(result.model.joints):
        coordinates[tree.coordinates_of(index)] = states.get(joint.name, 0.0)
    Ts = T_pose_root @ space.motions_to_input(tree.Ts_pose_canonical((coordinates / tree.units(space.scale))[None])[0])
    rest = {joint.name: _state(np.zeros(joint.kind.size)) for joint in result.model.joints}
    pose = Pose(
        model_digest=result.model.digest,
        units=result.model.units,
        states=rest | dict(states),
        T_pose_root=_transform(T_pose_root),
    )
    return PosedModel(pose, Ts)


def pose_by_targets(
    result: Result,
    p_source: Float64[np.ndarray, "targets 3"],
    p_target: Float64[np.ndarray, "targets 3"],
    limits: bool = False,
    free_base: bool | None = None,
) -> PosedModel:
    """The model's pose that brings points of the canonical frame closest to their targets (A.7).

    A source point moves with the part of the canonical point nearest to it. The base moves too where `free_base`, or
    by itself where it moved in the sequence. Input units. Raises InputError for a source point far off the object, and
    for a target out of all reach.
    """
    model, space = result.model, Normalisation.of(result.canonical_points)
    parts = _parts_of(result, p_source, FARTHEST * space.scale)
    _check_targets(p_source, p_target, OUT_OF_REACH * space.scale)
    if free_base is None:
        free_base = root_moves(space.motions(result.T_frame_canonical[:, model.root]))
    mechanism = _mechanism(result, space, limits, free_base)
    found = rearticulate(mechanism, space.points(p_source), parts, space.points(p_target))
    Ts = space.motions_to_input(found.Ts_pose_canonical)
    own = [mechanism.tree.coordinates_of(joint) for joint in range(len(model.joints) + free_base)]
    coordinates = found.coordinates * mechanism.tree.units(space.scale)
    undetermined = [bool((found.undetermined[mine] > UNDETERMINED).any()) for mine in own]
    bounded = [bool(found.bounded[mine].any()) for mine in own]
    names = [joint.name for joint in model.joints]
    residuals = np.linalg.norm(move_points(Ts[parts], p_source) - p_target, axis=1)
    pose = Pose(
        model_digest=model.digest,
        units=model.units,
        states={
            joint.name: _state_within(joint, coordinates[mine], limits)
            for joint, mine in zip(model.joints, own, strict=False)
        },
        T_pose_root=_transform(Ts[model.root]),
        undetermined=tuple(name for name, is_so in zip(names, undetermined, strict=False) if is_so),
        base_undetermined=free_base and undetermined[-1],
        at_limit=tuple(name for name, is_so in zip(names, bounded, strict=False) if is_so),
        targets=TargetFit(
            rms=float(np.sqrt((residuals**2).mean())),
            greatest=float(residuals.max()),
            residuals=tuple(residuals.tolist()),
        ),
    )
    return PosedModel(pose, Ts)


def _mechanism(result: Result, space: Normalisation, limits: bool, free_base: bool) -> Mechanism:
    """The model as it can be posed, within its limits where asked for."""
    mechanism = Mechanism.without_limits(_chain(result, space, free_base))
    if not limits:
        return mechanism
    tree, lower, upper = mechanism.tree, mechanism.lower.copy(), mechanism.upper.copy()
    for index, joint in enumerate(result.model.joints):
        own = tree.coordinates_of(index)
        upper[own] = joint.upper / tree.units(space.scale)[own]
        lower[own] = -upper[own] if joint.kind.is_ball else joint.lower / tree.units(space.scale)[own]
    return replace(mechanism, lower=lower, upper=upper)


def _chain(result: Result, space: Normalisation, free_base: bool) -> Chain:
    """The model's tree and states in the normalised frame."""
    model = result.model
    joints = [
        Joint(
            joint.kind,
            joint.parent,
            joint.child,
            np.array(joint.axis),
            space.points(np.array(joint.point)),
            np.array(joint.states).reshape(model.frames, -1) / joint.kind.units(space.scale),
        )
        for joint in model.joints
    ]
    T_frame_root = space.motions(result.T_frame_canonical[:, model.root])
    return Chain.of(joints, model.root, T_frame_root, free_base)


def _parts_of(
    result: Result, p_source: Float64[np.ndarray, "targets 3"], farthest: float
) -> Int64[np.ndarray, "targets"]:
    """The part of the canonical point nearest to each source point."""
    distance, index = nearest(KDTree(result.canonical_points.astype(np.float64)), p_source)
    if len(far := np.flatnonzero(distance > farthest)):
        first = far[0]
        raise InputError(
            f"row {first + 1}: found the source point {_words(p_source[first])}, {distance[first]:.4g} off the object"
            f"{f' (and {len(far) - 1} other rows)' if len(far) > 1 else ''}, expected one within {farthest:.4g}; "
            f"give points of the canonical frame {result.model.canonical_frame} in the model's own units"
        )
    return result.labels[index]


def _check_targets(
    p_source: Float64[np.ndarray, "targets 3"], p_target: Float64[np.ndarray, "targets 3"], farthest: float
) -> None:
    """Raises InputError for a target that no pose comes near to."""
    distance = np.abs(p_target - p_source).max(axis=1)
    if len(far := np.flatnonzero(distance > farthest)):
        first = far[0]
        raise InputError(
            f"row {first + 1}: found the target {_words(p_target[first])}, {distance[first]:.4g} from its source point"
            f"{f' (and {len(far) - 1} other rows)' if len(far) > 1 else ''}, expected one within {farthest:.4g}; "
            "give targets in the model's own units and coordinates"
        )


def _check_state(joint: ModelJoint, state: State, limits: bool) -> None:
    """Raises InputError for a state that the joint cannot have."""
    name, kind = shortened(joint.name, LONGEST_NAME), joint.kind
    shown = shortened(str(state), LONGEST_FIELD)
    if not are(state, kind.size):
        expected = "a rotation vector of three numbers" if kind.is_ball and kind.size == 3 else _counted(kind.size)
        raise InputError(f"joint {name}: found {shown}, expected {expected}, since it is {joint.type}; correct it")
    if not np.all(np.abs(state) <= GREATEST):
        raise InputError(f"joint {name}: found {shown}, expected finite numbers up to {GREATEST:g}; correct it")
    for size, lower, upper in zip(joint.sizes(state), joint.lowers, joint.uppers, strict=True):
        slack = ROUNDING * (1 + abs(upper - lower))
        if limits and not lower - slack <= size <= upper + slack:
            what = "a rotation by" if kind.is_ball else "the state"
            raise InputError(
                f"joint {name}: found {what} {size:.6g}, expected one within its limits, "
                f"{lower:.6g} to {upper:.6g}; correct it, or give --no-limits"
            )


def _counted(count: int) -> str:
    return "one number" if count == 1 else f"{count} numbers"


def _state_within(joint: ModelJoint, coordinates: Float64[np.ndarray, "own"], limits: bool) -> State:
    """A joint's state: an angle without limits is the one nearest to the observed range."""
    if joint.kind.is_ball:
        return _state(coordinates)
    if limits:
        return _state(np.clip(coordinates, joint.lowers, joint.uppers))
    turning = np.arange(len(coordinates)) < joint.kind.angles
    middle = (np.array(joint.lowers) + np.array(joint.uppers)) / 2
    turns = np.where(turning, np.round((coordinates - middle) / (2 * np.pi)), 0.0)
    return _state(coordinates - 2 * np.pi * turns)


def _state(coordinates: Float64[np.ndarray, "own"]) -> State:
    """A number, or several where the joint has more than one degree of freedom."""
    numbers = coordinates.tolist()
    return numbers[0] if len(numbers) == 1 else tuple(numbers)


def _transform(T: Float64[np.ndarray, "4 4"]) -> Transform:
    a, b, c, d = (tuple(row) for row in T.tolist())
    return a, b, c, d


def _listed(names: list[str]) -> str:
    """Names in a message: the first ones of many."""
    shown = [shortened(name, LONGEST_NAME) for name in names[:MOST_LISTED]]
    return ", ".join(shown + ["..."] * (len(names) > MOST_LISTED)) or "none at all"


def _words(p: Float64[np.ndarray, "3"]) -> str:
    return "(" + ", ".join(f"{value:.10g}" for value in p) + ")"
