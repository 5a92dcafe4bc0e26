import numpy as np
import pytest

from schemas.config import FinalFitConfig
from stages.assessment.evidence import evidence_of
from stages.final_fit.working import Fit, chain_of, working_frames


def evidence(model, sequence):
    frames = working_frames(sequence, model.canonical_frame, FinalFitConfig())
    return evidence_of(Fit(chain_of(model, free_root=False), model.labels[frames.index]), frames)


def test_the_true_model_leaves_what_sampling_does_and_its_parts_are_firm(hinged):
    model, sequence = hinged
    found = evidence(model, sequence)
    assert found.excess == pytest.approx(np.ones(len(found.excess)), abs=0.25)
    assert found.excess[model.canonical_frame] == 1.0
    assert found.unexplained.max() < 0.02
    assert found.firmness.shape == (2,)
    assert found.firmness.min() > 0.9
    assert found.open_share < 0.05


def test_noise_is_not_held_against_a_model(hinged, changed):
    model, sequence = hinged
    rng = np.random.default_rng(0)
    noisy = changed(sequence, lambda frames: [frame + rng.normal(0, 0.02, frame.shape) for frame in frames])
    assert evidence(model, noisy).excess.max() < 1.5


def test_a_frame_that_shows_something_else_stands_out(hinged, changed):
    model, sequence = hinged

    def turned(frames):
        return [frame[:, [1, 2, 0]] if t == 4 else frame for t, frame in enumerate(frames)]

    found = evidence(model, changed(sequence, turned))
    assert found.excess[4] > 2 > found.excess[[0, 1, 3]].max()
    assert found.unexplained[4] > 0.3 > found.unexplained[[0, 1, 3]].max()


def test_a_part_that_no_motion_tells_from_its_neighbour_is_not_firm(round_cap):
    found = evidence(*round_cap)
    assert found.firmness.min() < 0.3
    assert found.open_share > 0.1
    assert found.excess.max() < 1.3  # though all frames fit


def test_what_the_canonical_frames_camera_could_not_see_is_not_held_against_a_model(hinged, changed):
    """A frame shows a plate below the thing, which the canonical frame's camera sees from above only."""
    model, sequence = hinged
    low, high = sequence.points.min(axis=0), sequence.points.max(axis=0)
    plate = np.random.default_rng(0).uniform(0.4, 0.6, size=(60, 3)) * (high - low) + low
    plate[:, 2] = low[2] - 0.5 * (high - low)[2]

    def with_plate(frames):
        return [np.concatenate([frame, plate]) if t == 0 else frame for t, frame in enumerate(frames)]

    blind = changed(sequence, with_plate)
    above, below = ((low + high) / 2 + [0.0, 0.0, z] for z in (10.0, -10.0))
    cameras = np.tile(above, (blind.frame_count, 1, 1))
    cameras[0] = below
    seeing = blind.replace(viewpoints=cameras)
    held_against = evidence(model, blind).unexplained[0]
    assert held_against > 0.1
    assert evidence(model, seeing).unexplained[0] < 0.3 * held_against


def test_a_side_that_the_canonical_frames_camera_did_not_face_is_not_held_against_a_model(hinged, changed):
    """A frame shows the back of a thin screen beside the thing, and the canonical frame's camera is before it."""
    model, sequence = hinged
    low, high = sequence.points.min(axis=0), sequence.points.max(axis=0)
    size = high - low
    grid = np.stack([axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, 12), [2.0], np.linspace(0, 1, 12))], axis=1)
    screen = low + grid * size

    def with_screen(frames):
        return [np.concatenate([frame, screen]) if t == 0 else frame for t, frame in enumerate(frames)]

    changed_sequence = changed(sequence, with_screen)
    before, behind = ((low + high) / 2 + [0.0, y, 0.0] for y in (-10.0, 10.0))
    cameras = np.tile(before, (changed_sequence.frame_count, 1, 1))
    same_side = evidence(model, changed_sequence.replace(viewpoints=cameras.copy())).unexplained[0]
    cameras[0] = behind
    other_side = evidence(model, changed_sequence.replace(viewpoints=cameras)).unexplained[0]
    assert same_side > 0.1
    assert other_side < 0.3 * same_side
