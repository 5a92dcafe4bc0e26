import numpy as np

from schemas.config import FinalFitConfig
from stages.assessment.stage import compute_assessment


def test_the_true_model_is_good_and_its_joint_well_known(hinged):
    assessment = compute_assessment(*hinged, FinalFitConfig())
    assert assessment.verdict.trust == "good"
    [spread] = assessment.spreads
    assert spread.direction < np.radians(5)
    assert spread.place < 0.02


def test_a_cap_that_might_begin_anywhere_is_flagged(round_cap):
    assessment = compute_assessment(*round_cap, FinalFitConfig())
    assert assessment.verdict.trust == "poor"
    assert "fit another part's motion as well" in assessment.verdict.reasons[0]


def test_the_whole_may_move_in_front_of_the_camera(hinged, changed):
    """Every frame moved as a whole, and the root with it: the verdict stays, and the spreads nearly do."""
    model, sequence = hinged
    T = np.tile(np.eye(4), (model.Ts_frame_canonical.shape[0], 1, 1))
    T[:, :3, 3] = np.linspace(-0.2, 0.2, len(T))[:, None]
    T[:, :3, 3] -= T[model.canonical_frame, :3, 3]
    moved = changed(sequence, lambda frames: [frame + t[:3, 3] for frame, t in zip(frames, T, strict=True)])
    there = model.replace(Ts_frame_canonical=T[:, None] @ model.Ts_frame_canonical)
    before, after = (compute_assessment(*of, FinalFitConfig()) for of in ((model, sequence), (there, moved)))
    assert after.verdict.trust == "good"
    assert 0.5 < after.spreads[0].direction / before.spreads[0].direction < 3
