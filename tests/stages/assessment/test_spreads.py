import numpy as np
import pytest

from schemas.config import FinalFitConfig
from schemas.joints import SPHERICAL
from stages.assessment.spreads import axis_covariances, joint_spreads
from stages.final_fit.confidence import joint_confidence
from stages.final_fit.working import Fit, chain_of, working_frames
from stages.kernels.kinematics.chain import Chain, Joint

CONFIG = FinalFitConfig()


def prepared(model, sequence):
    frames = working_frames(sequence, model.canonical_frame, CONFIG)
    return Fit(chain_of(model, free_root=False), model.labels[frames.index]), frames


def spread_of(model, sequence):
    return joint_spreads(*prepared(model, sequence))[0]


def test_the_true_axis_is_within_two_spreads_of_the_fitted_one(hinged):
    model, sequence = hinged
    fit, frames = prepared(model, sequence)
    fitted = frames.refine(fit, 15)
    [spread] = joint_spreads(fitted, frames)
    tree = fitted.chain.tree
    turn = np.arcsin(np.linalg.norm(np.cross(tree.axis[0], model.axis[0])))
    away = np.linalg.norm(np.cross(tree.point[0] - model.point[0], model.axis[0]))
    assert turn < 2 * spread.direction < np.radians(10)
    assert away < 2 * spread.place < 0.05


def test_noise_makes_spreads_wider(hinged, changed):
    model, sequence = hinged
    rng = np.random.default_rng(0)
    noisy = changed(sequence, lambda frames: [frame + rng.normal(0, 0.02, frame.shape) for frame in frames])
    clean, blurred = spread_of(model, sequence), spread_of(model, noisy)
    assert blurred.direction > 1.5 * clean.direction
    assert blurred.place > 1.5 * clean.place


def test_an_axis_about_which_hardly_anything_turned_is_hardly_known(hinged, changed):
    """The same lid, seen twice as it lies in the canonical frame and a hair beside that."""
    model, sequence = hinged
    rng = np.random.default_rng(1)
    still = sequence.frames()[model.canonical_frame]
    sequence = changed(sequence, lambda frames: [still + rng.normal(0, 0.002, still.shape) for _ in frames])
    joints = [
        Joint(kind.kind, 0, 1, kind.axis, kind.point, 0.01 * kind.states) for kind in chain_of(model, False).joints()
    ]
    fit, frames = prepared(model, sequence)
    [spread] = joint_spreads(Fit(Chain.of(joints, 0, fit.chain.T_frame_root, False), fit.labels), frames)
    assert spread.direction > np.radians(45)
    assert spread.place > 0.2


def test_a_round_link_that_may_not_have_turned_at_all_is_wide(round_cap):
    fit, frames = prepared(*round_cap)
    [spread] = joint_spreads(fit, frames, joint_confidence(fit, frames, CONFIG.part_price))
    assert spread.direction > np.radians(45)


def test_a_slide_has_a_direction_and_no_place(sliding):
    spread = spread_of(*sliding)
    assert spread.direction < np.radians(5)
    assert spread.place is None


def test_a_ball_joint_has_no_direction_and_a_place_that_is_open_along_the_one_axis_it_turned_about(hinged):
    model, sequence = hinged
    fit, frames = prepared(model, sequence)
    hinge = fit.chain.joint(0)
    ball = Joint(SPHERICAL, 0, 1, hinge.axis, hinge.point, hinge.states * hinge.axis)
    ball_fit = Fit(fit.chain.with_joints([ball]), fit.labels)
    [spread] = joint_spreads(ball_fit, frames)
    assert spread.direction is None
    assert 0.4 < spread.place < 0.6
    [covariance] = axis_covariances(ball_fit, frames, 1.0)
    across = np.eye(3) - np.outer(hinge.axis, hinge.axis)
    assert np.sqrt(np.trace(across @ covariance[3:, 3:])) < 0.05


@pytest.mark.parametrize("confidence", [(0.2, 1.0, 1.0), (1.0, 1.0, 0.2)])
def test_an_axis_of_unsure_parts_or_kind_is_unsure(hinged, confidence):
    fit, frames = prepared(*hinged)
    sure, unsure = (joint_spreads(fit, frames, np.array([of]))[0] for of in ((1.0, 1.0, 1.0), confidence))
    assert unsure.direction > np.radians(45) > sure.direction
    assert unsure.place > 0.3 > sure.place


def test_a_model_without_joints_has_no_spreads(hinged):
    model, sequence = hinged
    fit, frames = prepared(model, sequence)
    assert joint_spreads(Fit(Chain.of([], 0, fit.chain.T_frame_root, False), 0 * fit.labels), frames) == ()


@pytest.mark.parametrize("free", [False, True])
def test_covariances_are_symmetric_positive_and_no_wider_than_what_is_possible(hinged, free):
    model, sequence = hinged
    frames = working_frames(sequence, model.canonical_frame, CONFIG)
    covariances = axis_covariances(Fit(chain_of(model, free), model.labels[frames.index]), frames, 1.0)
    assert covariances.shape == (1, 6, 6)
    assert covariances[0] == pytest.approx(covariances[0].T, abs=1e-12)
    assert np.all(np.linalg.eigvalsh(covariances[0]) > 0)
