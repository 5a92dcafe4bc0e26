"""The final fit: a tree of joints with one degree of freedom each, fitted to all frames, and labels to match (A.4)."""

from __future__ import annotations

import numpy as np

from schemas.config import FEW_FRAMES, FinalFitConfig
from schemas.flow import Flow
from schemas.joints import PRISMATIC, REVOLUTE, JointKind
from schemas.kinematic import KinematicModel
from schemas.relaxed import RECONSTRUCTION_ENERGIES
from schemas.sequence import PointSequence
from stages.final_fit.confidence import joint_confidence
from stages.final_fit.hidden_links import add_freedom
from stages.final_fit.joint_types import simplify_joints, try_hinges
from stages.final_fit.labelling import relabel
from stages.final_fit.parallel_slides import hang_slides
from stages.final_fit.pruning import prune
from stages.final_fit.rooting import rooted_in_the_middle
from stages.final_fit.working import Fit, Frames, to_chain, to_model, working_frames
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.quantisation import coarseness
from stages.relaxed_fit.reconstruction_energy import ReconstructionEnergy
from stages.support.progress import Progress, silent

STEPS = 4


def compute_final_fit(
    model: KinematicModel,
    sequence: PointSequence,
    flow: Flow,
    config: FinalFitConfig,
    rng: np.random.Generator,
    progress: Progress = silent,
    kinds: tuple[JointKind, ...] = (REVOLUTE, PRISMATIC),
    middle_root: bool = False,
) -> KinematicModel:
    """Joints made exact and fitted to the frames; labels, links and joints improved in turn.

    Links that the motion needs are inserted, points relabelled by the joints' motions, parts that the frames do not
    need joined with their neighbours, and slides on slides hung on what they touch. The answer's motions are exactly
    those of forward kinematics. Joints are of the given kinds. With
    `middle_root` the root of a body that nothing holds is the part in the middle of its tree. Deterministic; `rng` is
    not drawn from.
    """
    frames = working_frames(sequence, model.canonical_frame, config, kinds, [model])
    part_price, link_price, freedom_price = (
        frames.price(price) for price in (config.part_price, config.link_price, config.freedom_price)
    )
    labels = model.labels[frames.index]
    fit = Fit(to_chain(model, frames, config.still_root), labels)
    if config.hidden_links or frames.kinds != frames.plain_kinds:
        price = link_price if config.hidden_links else None
        fit = add_freedom(fit, frames, model.Ts_frame_canonical, price, freedom_price)
    fit = try_hinges(frames.refine(fit, config.iterations), frames, config.iterations)
    fit = simplify_joints(fit, frames, freedom_price)
    progress(1, STEPS)
    if config.relabel:
        fit = _settled(fit, frames, config, 2, (config.fused_frames + 1) // 2)
        progress(2, STEPS)
        if part_price > 0:
            fit = frames.refine(prune(fit, frames, part_price, config.prune_iterations), config.iterations)
        progress(3, STEPS)
        fit = _settled(fit, frames, config, config.rounds, config.fused_frames)
        if part_price > 0:
            pruned = prune(fit, frames, part_price, config.prune_iterations)
            if pruned.chain.parts < fit.chain.parts:
                fit = _settled(frames.refine(pruned, config.iterations), frames, config, 1, config.fused_frames)
            fit = hang_slides(fit, frames, part_price, config.iterations)
        fit = simplify_joints(fit, frames, freedom_price)
    if middle_root:
        fit = rooted_in_the_middle(fit)
    fit = frames.refine(fit, config.last_iterations)
    confidence = joint_confidence(fit, frames, part_price, coarseness(sequence.to_input(frames.p_all)))
    fitted = to_model(model.replace(confidence=None), fit, frames).replace(confidence=confidence)
    progress(STEPS, STEPS)
    energies = model.energies | reconstruction_energies(fitted, sequence, flow, config)
    return fitted.replace(energies=energies | {"E_fit": fit_energy(fit, frames, part_price)})


def suited_to(config: FinalFitConfig, sequence: PointSequence, own_frames: bool) -> FinalFitConfig:
    """The settings as they suit the frames.

    Of frames that had coordinates of their own, registration leaves small motions of the whole, so the root is not held
    still. Hidden links would explain what registration leaves where frames are few, and what known cameras did not see.
    """
    no_links = (own_frames and sequence.frame_count <= FEW_FRAMES) or sequence.viewpoints is not None
    return config.model_copy(
        update={
            "still_root": 0.0 if own_frames else config.still_root,
            "hidden_links": config.hidden_links and not no_links,
        }
    )


def fit_energy(fit: Fit, frames: Frames, part_price: float) -> float:
    """What the fit leaves of the frames, and the price of its parts, per point: lower is better."""
    return (frames.cost(fit) + part_price * fit.chain.parts) / len(fit.labels)


def _settled(fit: Fit, frames: Frames, config: FinalFitConfig, rounds: int, fused_frames: int) -> Fit:
    """Labels and joints improved in turn, until hardly a label changes."""
    for _ in range(rounds):
        relabelled = relabel(fit, frames, fused_frames, config.boundary_price, config.min_part_share)
        changed = np.mean(relabelled.labels != fit.labels)
        fit = frames.refine(relabelled, config.iterations)
        if changed < config.settled:
            break
    return fit


def reconstruction_energies(
    model: KinematicModel, sequence: PointSequence, flow: Flow, config: FinalFitConfig
) -> dict[str, float]:
    """E_recons and its terms (Eq. 5), for comparison with other fits."""
    energy = ReconstructionEnergy(sequence, flow, model.canonical_frame, config.energy, config.energy_points, 1)
    predicted = move_points(model.Ts_frame_canonical[:, model.labels[energy.index]], energy.p_canonical)
    return dict(zip(RECONSTRUCTION_ENERGIES, energy(predicted, 0).row(), strict=True))
