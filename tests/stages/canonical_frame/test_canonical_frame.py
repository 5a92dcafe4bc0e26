import numpy as np
import pytest

from schemas.config import CanonicalFrameConfig, FinalFitConfig, ProjectionConfig
from schemas.errors import InputError
from stages.canonical_frame.candidates import candidate_frames
from stages.canonical_frame.stage import compute_canonical_frame, openness
from stages.kernels.kinematics.tree import joint_transforms
from stages.kernels.motion.rigid_motion import move_points
from stages.projection.stage import link_parts

CONFIG = FinalFitConfig(points=400)


def candidate(truth, e_project=0.0, e_group=0.0, frame=2, off=0.0):
    """The true model as seen from a frame; its moving part `off` where it belongs in the others."""
    Ts = truth.Ts_frame_canonical @ np.linalg.inv(truth.Ts_frame_canonical[frame])
    Ts[np.arange(len(Ts)) != frame, 1, 2, 3] += off
    p, labels = truth.sequence.frames()[frame], truth.labels[frame]
    model = link_parts(p, labels, Ts, frame, ProjectionConfig())
    return model.replace(energies={"E_project": e_project, "E_group": e_group, "E_fit": 0.0})


def test_the_lowest_energy_of_projection_wins(hinge):
    models = [candidate(hinge, 3.0, 1.0), candidate(hinge, 1.0, 2.0), candidate(hinge, 0.5, 4.0)]
    choice = compute_canonical_frame(models, hinge.sequence, "project", CONFIG)
    assert choice.model is models[1]
    assert [c.e_project for c in choice.candidates] == [3.0, 1.0, 0.5]


@pytest.mark.parametrize("worse", [0, 1])
def test_the_better_fit_wins_whichever_its_canonical_frame(hinge, worse):
    frames = (2, 1)
    models = [candidate(hinge, frame=frames[k], off=0.02 * (k == worse)) for k in (0, 1)]
    choice = compute_canonical_frame(models, hinge.sequence, "fit", CONFIG)
    assert choice.model is models[1 - worse]
    assert choice.candidates[worse].e_fit > 1.2 * choice.candidates[1 - worse].e_fit


def test_the_same_model_costs_the_same_from_any_frame(hinge):
    one, other = compute_canonical_frame(
        [candidate(hinge), candidate(hinge, frame=3)], hinge.sequence, "fit", CONFIG
    ).candidates
    assert one.e_fit == pytest.approx(other.e_fit, rel=1e-6)


def test_the_first_of_equals_wins(hinge):
    models = [candidate(hinge), candidate(hinge)]
    assert compute_canonical_frame(models, hinge.sequence, "fit", CONFIG).model is models[0]


def test_of_few_frames_the_most_open_one_wins_where_both_fit(hinge):
    models = [candidate(hinge, frame=frame) for frame in range(5)]
    choice = compute_canonical_frame(models, hinge.sequence, "fit", CONFIG)
    volumes = [openness(p) for p in hinge.sequence.frames()]
    assert choice.model.canonical_frame == int(np.argmax(volumes))


def test_of_few_frames_the_fewest_parts_win_where_all_fit(hinge):
    most_open = int(np.argmax([openness(p) for p in hinge.sequence.frames()]))
    models = [candidate(hinge, frame=frame) for frame in range(5)]
    whole = models[most_open]
    labels = whole.labels.copy()
    labels[np.flatnonzero(labels == 1)[::2]] = 2  # every second point of the lid is a part of its own
    Ts = whole.Ts_frame_canonical[:, [0, 1, 1]]
    cut = link_parts(hinge.sequence.frames()[most_open], labels, Ts, most_open, ProjectionConfig())
    models[most_open] = cut.replace(energies=whole.energies)
    choice = compute_canonical_frame(models, hinge.sequence, "fit", CONFIG.model_copy(update={"part_price": 0.0}))
    assert choice.candidates[most_open].e_fit < 1.01 * min(one.e_fit for one in choice.candidates)
    assert choice.model.part_count == 2


def test_openness_does_not_depend_on_how_a_scan_lies(hinge):
    p = hinge.sequence.frames()[0]
    T = joint_transforms(np.zeros(3), np.array([0.3, -1.0, 2.0, 1.0, -4.0, 0.5]))
    assert openness(move_points(T, p)) == pytest.approx(openness(p), rel=1e-6)
    assert 0 <= openness(p * [1.0, 1.0, 0.0]) < 1e-6


def test_no_candidate_is_an_error(hinge):
    with pytest.raises(ValueError, match="at least one"):
        compute_canonical_frame([], hinge.sequence, "fit", CONFIG)


def test_candidates_are_the_middle_frame_and_its_neighbours():
    assert candidate_frames([400] * 10, CanonicalFrameConfig(candidates=3)) == (5, 4, 6)
    assert candidate_frames([400] * 9, CanonicalFrameConfig(candidates=1)) == (4,)


def test_asking_for_more_candidates_keeps_the_first_ones():
    assert candidate_frames([400] * 10, CanonicalFrameConfig(candidates=5))[:2] == candidate_frames(
        [400] * 10, CanonicalFrameConfig(candidates=2)
    )


def test_all_of_a_few_frames_are_candidates():
    assert sorted(candidate_frames([400] * 5, CanonicalFrameConfig())) == [0, 1, 2, 3, 4]
    assert candidate_frames([400] * 10, CanonicalFrameConfig()) == (5, 4)


def test_a_short_sequence_repeats_its_frames():
    assert candidate_frames([400] * 2, CanonicalFrameConfig(candidates=3)) == (1, 0, 1)


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        ((800, 200_000, 100), (0, 0)),
        ((2000, 2000, 150, 2000, 2000), (1, 3)),
        ((300, 20_000, 300, 3000), (3, 3)),
        ((5000, 500), (0, 0)),
        ((3000, 4096, 2000, 4000, 3500), (2, 1)),
    ],
)
def test_frames_of_an_unusual_density_are_not_tried(counts, expected):
    assert candidate_frames(counts, CanonicalFrameConfig(candidates=2)) == expected


def test_of_two_densities_the_denser_is_tried():
    assert candidate_frames((100, 100, 100_000, 100_000), CanonicalFrameConfig(candidates=2)) == (2, 3)


def test_configured_frames_are_taken_as_they_are():
    assert candidate_frames([400] * 10, CanonicalFrameConfig(frames=(2, 7))) == (2, 7)


def test_a_configured_frame_that_is_not_there_is_refused():
    with pytest.raises(InputError, match=r"found 12, expected 0\.\.9"):
        candidate_frames([400] * 10, CanonicalFrameConfig(frames=(2, 12)))
