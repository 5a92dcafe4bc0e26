"""What the clouds say for and against a fitted model as a whole."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64
from sklearn.metrics import adjusted_rand_score

from schemas.assessment import Evidence
from stages.final_fit.labelling import label_problem
from stages.final_fit.working import Fit, Frames
from stages.kernels.alignment.registration import Registration
from stages.kernels.alignment.visibility import View
from stages.kernels.motion.rigid_motion import inverse, move_points

OFF = 3.0  # spacings from the model beyond which a point is unexplained: sampled surfaces have gaps of up to two
BONUS = 0.1  # what each point is paid that goes over to a part, in costs of a point: below what evidence brings


def evidence_of(fit: Fit, frames: Frames) -> Evidence:
    """Residuals against what sampling and noise leave, points off the model, and how firm the labels are."""
    registration = frames.registration
    count = len(registration.frames)
    excess, unexplained = np.ones(count), np.zeros(count)
    floor = _floor(frames, frames.canonical_frame)
    for t in registration.others:
        pairs = registration.pairs(t, fit.labels, fit.chain.Ts)
        left = registration.pair_costs(t, pairs)[pairs.tells > 0].mean()
        excess[t] = 2 * left / max(floor + _floor(frames, t), 1e-12)
        distance, normals = pairs.distance[len(fit.labels) :], pairs.normal[len(fit.labels) :]  # of the frame's points
        off = np.flatnonzero(distance > OFF)
        unexplained[t] = _told_before(fit, registration, t, off, normals[off]).sum() / len(distance)
    firmness, open_share = label_firmness(fit, frames)
    return Evidence(excess=excess, unexplained=unexplained, firmness=firmness, open_share=open_share)


def _told_before(
    fit: Fit,
    registration: Registration,
    t: int,
    index: Int64[np.ndarray, "points"],
    normals: Float64[np.ndarray, "points 3"],
) -> Float64[np.ndarray, "points"]:
    """How much it says that the canonical frame lacks points of frame t, whichever part they belong to.

    Where cameras are known, it says nothing of surfaces that those of the canonical frame would see from behind or edge
    on.
    """
    canonical, p = registration.canonical_frame, registration.frames[t][index]
    far, homes = np.full(len(index), np.inf), inverse(fit.chain.Ts[t])
    told = np.min([registration.tells(canonical, move_points(T, p), far) for T in homes], axis=0)
    if registration.views is None:
        return told
    here, before = registration.views[t], registration.views[canonical]
    if isinstance(here, View) and isinstance(before, View):
        outward = here.outward(p, normals)
        told = told * np.all([before.faces(move_points(T, p), outward @ T[:3, :3].T) for T in homes], axis=0)
    return told


def _floor(frames: Frames, t: int) -> float:
    """The mean cost of a frame's points against their neighbours: what sampling and noise leave."""
    return float(frames.registration.own_costs(t).mean())


def label_firmness(fit: Fit, frames: Frames) -> tuple[Float64[np.ndarray, "parts"], float]:
    """How firm the labels are against each part's growth (`Evidence.firmness`), and the share of points that give way.

    Each part is offered the points of its neighbours. It gets those that cost no more with it, boundaries included, but
    for a small bonus a point. Where a part looks alike however it moves, its boundary can be anywhere.
    """
    problem = label_problem(fit, frames, frames.p, fit.labels, frames.config.boundary_price)
    grown = [problem.expand(fit.labels, part, BONUS) for part in range(fit.chain.parts)]
    firmness = np.array([adjusted_rand_score(fit.labels, labels) for labels in grown], dtype=np.float64)
    return firmness, float(np.mean([labels != fit.labels for labels in grown], axis=0).astype(bool).mean())
