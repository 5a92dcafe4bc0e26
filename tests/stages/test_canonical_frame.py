import pytest

from schemas.config import CanonicalFrameConfig, ProjectionConfig
from schemas.errors import InputError
from stages.canonical_frame import candidate_frames, choose
from stages.projection import link_parts


def candidate(truth, e_project, e_group, e_fit=0.0):
    model = link_parts(
        truth.sequence.frames()[2], truth.canonical_labels, truth.Ts_frame_canonical, 2, ProjectionConfig()
    )
    return model.replace(energies={"E_project": e_project, "E_group": e_group, "E_fit": e_fit})


@pytest.mark.parametrize(("by", "best"), [("project", 1), ("fit", 2)])
def test_the_lowest_energy_wins(hinge, by, best):
    models = [candidate(hinge, 3.0, 1.0, 0.2), candidate(hinge, 1.0, 2.0, 0.3), candidate(hinge, 0.5, 4.0, 0.1)]
    choice = choose(models, by)
    assert choice.model is models[best]
    assert [c.e_project for c in choice.candidates] == [3.0, 1.0, 0.5]


def test_the_first_of_equals_wins(hinge):
    models = [candidate(hinge, 1.0, 1.0), candidate(hinge, 1.0, 1.0)]
    assert choose(models, "fit").model is models[0]


def test_no_candidate_is_an_error():
    with pytest.raises(ValueError, match="at least one"):
        choose([], "fit")


def test_candidates_are_the_middle_frame_and_its_neighbours():
    assert candidate_frames(10, CanonicalFrameConfig(candidates=3)) == (5, 4, 6)
    assert candidate_frames(9, CanonicalFrameConfig(candidates=1)) == (4,)


def test_asking_for_more_candidates_keeps_the_first_ones():
    assert candidate_frames(10, CanonicalFrameConfig(candidates=5))[:2] == candidate_frames(
        10, CanonicalFrameConfig(candidates=2)
    )


def test_a_short_sequence_repeats_its_frames():
    assert candidate_frames(2, CanonicalFrameConfig(candidates=3)) == (1, 0, 1)


def test_configured_frames_are_taken_as_they_are():
    assert candidate_frames(10, CanonicalFrameConfig(frames=(2, 7))) == (2, 7)


def test_a_configured_frame_that_is_not_there_is_refused():
    with pytest.raises(InputError, match=r"found 12, expected 0\.\.9"):
        candidate_frames(10, CanonicalFrameConfig(frames=(2, 12)))
