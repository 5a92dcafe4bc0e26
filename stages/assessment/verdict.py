"""The verdict on a model: one word, and sentences that say why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from schemas.assessment import Evidence, Spread, Trust, Verdict
from schemas.kinematic import KinematicModel

# Thresholds were measured: benchmarks/README.md, "Spreads and verdicts".
UNFITTED, UNFITTED_EXCESS = 0.2, 2.0  # a frame that leaves more points off the model, or more in all, is not fitted
UNEXPLAINED = 0.03  # share of a frame's points off the model beyond which something is missing
FIRM, LOOSE = 0.75, 0.3  # firmness of all labels below which they are open, and below which the parts are a guess
SURE_OF_PARTS, SURE_OF_LINK, SURE_OF_TYPE = 0.5, 0.25, 0.5  # confidences below which a joint is uncertain
WIDE = 10.0  # degrees; a direction that is known less exactly is uncertain
NAMED = 3  # frames or joints that a sentence names at most

DOUBT, FAULT = 1, 2  # what a reason makes of a model: doubtful, or poor
Reason = tuple[int, str]
TRUST: tuple[Trust, ...] = ("good", "doubtful", "poor")


def verdict_on(
    model: KinematicModel, spreads: Sequence[Spread], evidence: Evidence, frame_names: Sequence[str]
) -> Verdict:
    """The verdict on a model from its confidences, spreads and evidence. Joints bear the names of model.json."""
    found = [
        *_of_frames(evidence, frame_names),
        *_of_motion(model),
        *_of_residuals(evidence),
        *_of_labels(evidence),
        *_of_joints(model, spreads),
    ]
    reasons = (*(sentence for _, sentence in found), _misfit(evidence, model.canonical_frame))
    return Verdict(trust=TRUST[max((weight for weight, _ in found), default=0)], reasons=reasons)


def _of_frames(evidence: Evidence, names: Sequence[str]) -> Iterator[Reason]:
    unfitted = _unfitted(evidence)
    if unfitted.any():
        which = _listed([names[t] for t in np.flatnonzero(unfitted).tolist()])
        yield FAULT, f"the model does not fit {which}: it could not be connected to the others, or moved otherwise"


def _of_motion(model: KinematicModel) -> Iterator[Reason]:
    if not model.joint_types:
        yield (
            FAULT,
            "nothing moved: one rigid part and no joints were found; the object may be rigid, or move by less than the "
            "spacing of its points",
        )


def _of_residuals(evidence: Evidence) -> Iterator[Reason]:
    share = float(evidence.unexplained[~_unfitted(evidence)].max(initial=0.0))
    if share > UNEXPLAINED:
        yield DOUBT, f"up to {100 * share:.0f} % of a frame's points lie off the model: a part or a motion is missing"


def _of_labels(evidence: Evidence) -> Iterator[Reason]:
    losses = 1 - evidence.firmness
    if 1 - losses.sum() < FIRM:
        parts = _listed([f"part_{part}" for part in np.flatnonzero(losses > losses.max() / 2)])
        yield (
            FAULT if 1 - losses.sum() < LOOSE else DOUBT,
            f"{100 * evidence.open_share:.0f} % of the points fit another part's motion as well: where {parts} end is "
            "a guess",
        )


def _of_joints(model: KinematicModel, spreads: Sequence[Spread]) -> Iterator[Reason]:
    names = [f"joint_{a}_{b}" for a, b in zip(model.joint_parent, model.joint_child, strict=True)]

    def at(joints: np.ndarray) -> str:
        return "at " + _listed([names[joint] for joint in joints])

    if model.confidence is not None:
        doubts = (
            (SURE_OF_PARTS, "no joint may be needed, as the parts move nearly as one"),
            (SURE_OF_LINK, "the part may hang on another one, or move more freely"),
            (SURE_OF_TYPE, "another type of joint may be right"),
        )
        for (least, doubt), confidence in zip(doubts, model.confidence.T, strict=True):
            if (confidence < least).any():
                yield DOUBT, f"{at(np.flatnonzero(confidence < least))} {doubt} (confidence {confidence.min():.2f})"
    degrees = np.degrees([spread.direction or 0.0 for spread in spreads])
    if (degrees > WIDE).any():
        yield DOUBT, f"{at(np.flatnonzero(degrees > WIDE))} the axis is known to {degrees.max():.0f} degrees only"


def _misfit(evidence: Evidence, canonical_frame: int) -> str:
    others = np.delete(evidence.excess, canonical_frame)
    misfit = float(others.mean()) if len(others) else 1.0
    return f"the misfit is {misfit:.2f} times what the clouds' sampling and noise alone cause"


def _unfitted(evidence: Evidence) -> np.ndarray:
    return (evidence.unexplained > UNFITTED) | (evidence.excess > UNFITTED_EXCESS)


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:NAMED])
    return shown if len(names) <= NAMED else f"{shown} and {len(names) - NAMED} more"
