"""The assessment: spreads of a model's joints, and a verdict on the model, from the clouds that it was fitted to."""

from __future__ import annotations

from schemas.assessment import Assessment
from schemas.config import FinalFitConfig
from schemas.kinematic import KinematicModel
from schemas.sequence import PointSequence
from stages.assessment.evidence import evidence_of
from stages.assessment.spreads import joint_spreads
from stages.assessment.verdict import verdict_on
from stages.final_fit.working import Fit, chain_of, contact_points, root_moves, working_frames


def compute_assessment(model: KinematicModel, sequence: PointSequence, config: FinalFitConfig) -> Assessment:
    """Judge the chosen model by the clouds, on the points that the final fit works on."""
    frames = working_frames(sequence, model.canonical_frame, config, models=[model])
    model = model.replace(point=contact_points(model, frames.p_all))
    chain = chain_of(model, root_moves(model.Ts_frame_canonical[:, model.root]))
    fit = Fit(chain, model.labels[frames.index])
    spreads = joint_spreads(fit, frames, model.confidence)
    evidence = evidence_of(fit, frames)
    return Assessment(
        spreads=spreads,
        evidence=evidence,
        verdict=verdict_on(model, spreads, evidence, sequence.frame_names),
    )
