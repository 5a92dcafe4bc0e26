import numpy as np
import pytest

from schemas.relaxed import RelaxedModel
from stages.relaxed_fit.carry_over import carry_over


def relaxed(truth, labels, Ts):
    return RelaxedModel(
        canonical_frame=2,
        labels=labels,
        Ts_frame_canonical=Ts,
        energy_history=np.zeros((0, 4)),
        solver="truth",
        iterations=0,
    )


@pytest.mark.parametrize("frame", [0, 2, 4])
def test_true_parts_and_motions_stay_true_from_any_frame(two_part_object, frame):
    truth = two_part_object
    model = carry_over(
        relaxed(truth, truth.canonical_labels, truth.Ts_frame_canonical), truth.sequence, canonical_frame=frame
    )
    assert model.canonical_frame == frame
    np.testing.assert_array_equal(model.labels, truth.labels[frame])
    expected = truth.Ts_frame_canonical @ np.linalg.inv(truth.Ts_frame_canonical[frame])
    np.testing.assert_allclose(model.Ts_frame_canonical, expected, atol=1e-12)


def test_parts_that_the_other_frame_does_not_show_are_dropped(hinge):
    labels = hinge.canonical_labels.copy()
    labels[0] = 2
    Ts = hinge.Ts_frame_canonical[:, [0, 1, 0]].copy()
    Ts[0, 2, 2, 3] += 10.0  # far from every point of frame 0
    model = carry_over(relaxed(hinge, labels, Ts), hinge.sequence, canonical_frame=0)
    assert model.Ts_frame_canonical.shape[1] == 2
    np.testing.assert_array_equal(model.labels, hinge.labels[0])
