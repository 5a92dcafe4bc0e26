"""Evaluation: the yardsticks of A.9, measured on the canonical frame's points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64, Int64
from pykdtree.kdtree import KDTree
from sklearn.metrics import adjusted_rand_score, rand_score

from schemas.assessment import Assessment, Spread
from schemas.config import EvaluationConfig
from schemas.kinematic import KinematicModel
from schemas.metrics import JointMetrics, JointVerdict, Metrics
from schemas.sequence import GroundTruth, IngestedSequence, TrueJoint
from stages.evaluation.identifiability import observable_points
from stages.evaluation.seen import seen_parts, trees_of_seen
from stages.evaluation.travel import joint_travels
from stages.evaluation.tree_edit_distance import unordered_tree_edit_distance
from stages.evaluation.true_motion import (
    in_shared_coordinates,
    motion_errors,
    placed,
    since_canonical,
    true_positions,
)
from stages.final_fit.working import chain_of, contact_points, root_moves
from stages.kernels.labelling.matching import match_parts
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.sampling import working_points
from stages.rearticulation.mechanism import Mechanism
from stages.rearticulation.solver import rearticulate

OBSERVABLE = 0.1  # a part with a smaller share of observable points is not observable itself


def compute_evaluation(
    model: KinematicModel,
    ingested: IngestedSequence,
    config: EvaluationConfig,
    rng: np.random.Generator,
    assessment: Assessment | None = None,
) -> Metrics:
    """Measure a model against its sequence and, where there is one, against the ground truth (A.9).

    Lengths come out in the input's units and in % of the object's diagonal; `rng` draws the points that
    the reanimation metric is given. Without ground truth only the Chamfer distance and the counts are known; where
    only the true surface is, also the errors of the motion. Points of no true part count for the Chamfer distance only.
    True parts that no frame shows are not counted. Where each frame has coordinates of its own, errors of motion are
    measured after the rigid motion of the whole that is best in each frame. An `assessment` of the model is measured
    too: its verdict and its joints' spreads go beside what they speak of.
    """
    sequence, truth = ingested.sequence, ingested.truth
    frames = sequence.frames()
    spreads = () if assessment is None else assessment.spreads
    p_predicted = move_points(model.Ts_frame_canonical[:, model.labels], frames[model.canonical_frame])
    metrics = Metrics(
        units=sequence.units,
        diagonal=sequence.scale,
        canonical_frame=model.canonical_frame,
        parts_found=model.part_count,
        chamfer_percent=100 * chamfer_distance(p_predicted, frames),
        trust=None if assessment is None else assessment.verdict.trust,
    )
    of_object = [ingested.of_object(t) for t in range(len(frames))]
    canonical = of_object[model.canonical_frame]
    if not canonical.any():
        return metrics
    if (p_true := true_positions(ingested, model.canonical_frame)) is not None:
        p_predicted = p_predicted[:, canonical]
        if truth is not None and truth.own_coordinates:
            placement = 100 * float(np.linalg.norm(p_predicted - p_true, axis=-1).mean())
            metrics = metrics.replace(placement_percent=placement)
            p_predicted, p_true = in_shared_coordinates(p_predicted, p_true, truth, model.canonical_frame)
        errors = motion_errors(p_predicted, p_true, model.canonical_frame, sequence)
        metrics = metrics.replace(**errors.figures(sequence.scale))
    if truth is None:
        return metrics
    model = model.replace(labels=model.labels[canonical])
    frames = [frame[points] for frame, points in zip(frames, of_object, strict=True)]
    labels_of_frames = [
        labels[points] for labels, points in zip(sequence.by_frame(truth.labels), of_object, strict=True)
    ]
    p_canonical, labels_true = frames[model.canonical_frame], labels_of_frames[model.canonical_frame]
    model = model.replace(point=contact_points(model, p_canonical))
    Ts_true = since_canonical(truth.Ts_frame_first, truth, model.canonical_frame)
    reanimation = reanimation_error(model, truth, labels_true, p_canonical, config.reanimation_iterations, rng)
    seen = seen_parts(labels_of_frames, len(truth.parent))
    joints = tuple(
        joint.model_copy(update={"travel_spacings": travel})
        for joint, travel, true in zip(
            joint_errors(model, truth, labels_true, spreads),
            joint_travels(truth, frames, labels_of_frames),
            truth.joints,
            strict=True,
        )
        if seen[true.parent] and seen[true.child]
    )
    type_right = [joint.predicted_type == joint.true_type for joint in joints if joint.predicted_type is not None]
    looked_at = [working_points(frame, config.told_points) for frame in frames]
    observable = observable_points(
        [frame[index] for frame, index in zip(frames, looked_at, strict=True)],
        [labels[index] for labels, index in zip(labels_of_frames, looked_at, strict=True)],
        Ts_true,
        model.canonical_frame,
    )
    observed = looked_at[model.canonical_frame][observable]
    return metrics.replace(
        parts_true=int(seen.sum()),
        unseen_parts=tuple(truth.part_names[part] for part in np.flatnonzero(~seen)),
        ari=float(adjusted_rand_score(labels_true, model.labels)),
        ri=float(rand_score(labels_true, model.labels)),
        told_share=float(observable.mean()),
        ari_told=float(adjusted_rand_score(labels_true[observed], model.labels[observed])) if len(observed) else None,
        untold_parts=_unobservable_parts(truth, labels_true[looked_at[model.canonical_frame]], observable),
        tree_edit_distance=_tree_edit_distance(model, truth, seen),
        reanimation=None if reanimation is None else reanimation * sequence.scale,
        reanimation_percent=None if reanimation is None else 100 * reanimation,
        joint_type_accuracy=float(np.mean(type_right)) if type_right else None,
        joints=joints,
        verdicts=joint_verdicts(model, truth, labels_true),
    )


def _unobservable_parts(
    truth: GroundTruth, labels_true: Int64[np.ndarray, "points"], observable: Bool[np.ndarray, "points"]
) -> tuple[str, ...]:
    """The names of true parts with a share of observable points below `OBSERVABLE`."""
    count = len(truth.parent)
    points = np.bincount(labels_true, minlength=count)
    points_observable = np.bincount(labels_true[observable], minlength=count)
    return tuple(truth.part_names[part] for part in np.flatnonzero(points_observable < OBSERVABLE * points))


def chamfer_distance(
    p_predicted: Float64[np.ndarray, "frames points 3"], frames: list[Float64[np.ndarray, "points 3"]]
) -> float:
    """Distance to the nearest point, averaged over points, over both directions and over frames."""
    both = [
        (KDTree(p).query(predicted)[0].mean() + KDTree(predicted).query(p)[0].mean()) / 2
        for predicted, p in zip(p_predicted, frames, strict=True)
    ]
    return float(np.mean(both))


def reanimation_error(
    model: KinematicModel,
    truth: GroundTruth,
    labels_true: Int64[np.ndarray, "points"],
    p_canonical: Float64[np.ndarray, "points 3"],
    iterations: int,
    rng: np.random.Generator,
) -> float | None:
    """Mean distance to the true unseen states when the model is given the place of one random point of each true part.

    Normalised; None where there are no unseen states. The root is free where it moved in the sequence.
    """
    if len(truth.Ts_novel_first) == 0:
        return None
    given = np.array([rng.choice(np.flatnonzero(labels_true == part)) for part in np.unique(labels_true)])
    return float(reanimation_distances(model, truth, labels_true, p_canonical, given, iterations).mean())


def reanimation_distances(
    model: KinematicModel,
    truth: GroundTruth,
    labels_true: Int64[np.ndarray, "points"],
    p_canonical: Float64[np.ndarray, "points 3"],
    given: Int64[np.ndarray, "given"],
    iterations: int,
) -> Float64[np.ndarray, "states points"]:
    """How far each point is from its true place in the unseen states, when the places of some of them are given.

    Where each frame has coordinates of its own, the best rigid motion of the whole comes first.
    """
    p_true = move_points(
        since_canonical(truth.Ts_novel_first, truth, model.canonical_frame)[:, labels_true], p_canonical
    )
    free_root = truth.own_coordinates or root_moves(model.Ts_frame_canonical[:, model.root])
    mechanism = Mechanism.without_limits(chain_of(model, free_root))
    found = [rearticulate(mechanism, p_canonical[given], model.labels[given], p[given], iterations) for p in p_true]
    Ts_novel_canonical = np.stack([pose.Ts_pose_canonical for pose in found])
    p_found = move_points(Ts_novel_canonical[:, model.labels], p_canonical)
    if truth.own_coordinates:
        p_found = placed(p_found, p_true)
    distances: np.ndarray = np.linalg.norm(p_found - p_true, axis=-1)
    return distances


def joint_errors(
    model: KinematicModel,
    truth: GroundTruth,
    labels_true: Int64[np.ndarray, "points"],
    spreads: Sequence[Spread] = (),
) -> tuple[JointMetrics, ...]:
    """Each true joint against the predicted joint, of either direction, between the parts matched to its own.

    `spreads`, normalised, are those of the predicted joints at their points.
    """
    matched = match_parts(model.labels, labels_true)
    joint_of = {link: joint for joint, link in enumerate(_links(model))}
    errors = []
    for true in truth.joints:
        link = _matched_link(matched, true)
        if link in joint_of:
            error = _joint_error(model, joint_of[link], matched[true.parent], truth, true)
            errors.append(error.model_copy(update=_spread(spreads[joint_of[link]])) if spreads else error)
        else:
            errors.append(JointMetrics(name=true.name, true_type=true.type, predicted_type=None))
    return tuple(errors)


def joint_verdicts(
    model: KinematicModel, truth: GroundTruth, labels_true: Int64[np.ndarray, "points"]
) -> tuple[JointVerdict, ...]:
    """Whether each predicted joint is a true one, and how sure the model was; none where either is unknown."""
    if not truth.joints:
        return ()
    matched = match_parts(model.labels, labels_true)
    true_links = {_matched_link(matched, true) for true in truth.joints}
    sure = [(link, _confidence(model, joint)) for joint, link in enumerate(_links(model))]
    return tuple(JointVerdict(confidence=value, right=link in true_links) for link, value in sure if value is not None)


def _links(model: KinematicModel) -> list[frozenset[int]]:
    """The two parts of each predicted joint."""
    return [frozenset(link) for link in zip(model.joint_parent.tolist(), model.joint_child.tolist(), strict=True)]


def _matched_link(matched: dict[int, int], true: TrueJoint) -> frozenset[int]:
    """The predicted parts that were matched to those of a true joint; -1 where there is none."""
    return frozenset((matched.get(true.parent, -1), matched.get(true.child, -1)))


def _confidence(model: KinematicModel, joint: int) -> float | None:
    """How sure the model is of a joint: as sure as of what it is least sure of."""
    return None if model.confidence is None else float(model.confidence[joint].min())


def _joint_error(model: KinematicModel, joint: int, parent: int, truth: GroundTruth, true: TrueJoint) -> JointMetrics:
    """One predicted joint against the true one, whose parent was matched to the predicted part `parent`."""
    predicted_type, kind = model.joint_types[joint], model.kinds[joint]
    if not (true.kind.has_axis and kind.has_axis):
        balls = kind.is_ball and true.kind.is_ball
        centre_distance = _centre_distance(model, joint, truth, true) if balls else None
        return JointMetrics(
            name=true.name,
            true_type=true.type,
            predicted_type=predicted_type,
            ball_centre_percent=centre_distance,
            place_percent=centre_distance,
            confidence=_confidence(model, joint),
        )
    T_canonical_first = truth.Ts_frame_first[model.canonical_frame, true.parent]
    axis_true = T_canonical_first[:3, :3] @ np.asarray(true.axis)
    point_true = T_canonical_first[:3, :3] @ np.asarray(true.point) + T_canonical_first[:3, 3]
    axis, point = model.axis[joint], model.point[joint]
    located = true.kind.turns == "axis" and kind.turns == "axis"
    reversed_joint = (axis @ axis_true < 0) != (model.joint_parent[joint] != parent)
    sign = -1 if reversed_joint else 1
    state_error = None
    if kind == true.kind and kind.size == 1:
        state_error = _state_error(sign * model.states_of(joint)[:, 0], true, model.canonical_frame)
    return JointMetrics(
        name=true.name,
        true_type=true.type,
        predicted_type=predicted_type,
        axis_angle_deg=float(np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, axis_true)), abs(axis @ axis_true)))),
        axis_distance_percent=100 * line_distance(axis, point, axis_true, point_true) if located else None,
        place_percent=100 * float(np.linalg.norm(np.cross(point - point_true, axis_true))) if located else None,
        state_error=state_error,
        confidence=_confidence(model, joint),
    )


def _spread(spread: Spread) -> dict[str, float | None]:
    """The fields of `JointMetrics` for the spread of a predicted joint."""
    return {
        "direction_spread_deg": None if spread.direction is None else float(np.degrees(spread.direction)),
        "place_spread_percent": None if spread.place is None else 100 * spread.place,
    }


def _centre_distance(model: KinematicModel, joint: int, truth: GroundTruth, true: TrueJoint) -> float:
    """Between the centres of two ball joints in the canonical frame, in % of the diagonal."""
    T_canonical_first = truth.Ts_frame_first[model.canonical_frame, true.child]  # the centre is the child's own
    centre = T_canonical_first[:3, :3] @ np.asarray(true.point) + T_canonical_first[:3, 3]
    return 100 * float(np.linalg.norm(model.point[joint] - centre))


def _state_error(states: Float64[np.ndarray, "frames"], true: TrueJoint, canonical_frame: int) -> float:
    """Mean |difference| of the states since the canonical frame: radians, or % of the diagonal."""
    difference = (states - states[canonical_frame]) - (np.asarray(true.states) - true.states[canonical_frame])
    if true.kind.turns == "none":
        return 100 * float(np.abs(difference).mean())
    return float(np.abs((difference + np.pi) % (2 * np.pi) - np.pi).mean())


def line_distance(
    axis_a: Float64[np.ndarray, "3"],
    point_a: Float64[np.ndarray, "3"],
    axis_b: Float64[np.ndarray, "3"],
    point_b: Float64[np.ndarray, "3"],
) -> float:
    """The least distance between two lines, each through its point along its unit axis."""
    between = point_b - point_a
    normal = np.cross(axis_a, axis_b)
    sine = np.linalg.norm(normal)
    if sine < 1e-6:  # parallel
        return float(np.linalg.norm(np.cross(between, axis_a)))
    return float(abs(between @ normal) / sine)


def _tree_edit_distance(model: KinematicModel, truth: GroundTruth, seen: Bool[np.ndarray, "parts"]) -> int | None:
    """The least over the trees of what is seen. None where the source does not tell the tree, with exactly one root."""
    if np.count_nonzero(truth.parent == -1) != 1:
        return None
    return min(unordered_tree_edit_distance(model.parents(), tree) for tree in trees_of_seen(truth.parent, seen))
