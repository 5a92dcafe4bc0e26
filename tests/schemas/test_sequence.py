import numpy as np
import pytest
from pydantic import ValidationError


def test_frames_are_the_points_in_order(samples):
    sequence = samples["sequence"]
    assert [len(frame) for frame in sequence.frames()] == [5, 4, 3]
    assert np.array_equal(np.concatenate(sequence.frames()), sequence.points)


def test_input_coordinates_are_scaled_and_shifted(samples):
    sequence = samples["sequence"]
    assert np.allclose(sequence.to_input(np.zeros(3)), sequence.centre)
    assert np.allclose(sequence.to_input(np.ones((2, 3))) - sequence.centre, sequence.scale)


@pytest.mark.parametrize("counts", [[5, 4, 2], [5, 7, 0], [5, 8, -1]])
def test_counts_that_do_not_add_up_are_refused(samples, counts):
    with pytest.raises(ValidationError, match="point_counts"):
        samples["sequence"].replace(point_counts=np.array(counts))


@pytest.mark.parametrize("change", [{"scale": 0.0}, {"units": "inch"}, {"frame_names": ("a", "b")}])
def test_other_impossible_sequences_are_refused(samples, change):
    with pytest.raises(ValidationError, match=next(iter(change))):
        samples["sequence"].replace(**change)


@pytest.mark.parametrize(
    "change", [{"labels": np.zeros(11, dtype=np.int64)}, {"Ts_frame_first": np.tile(np.eye(4), (2, 2, 1, 1))}]
)
def test_truth_of_another_sequence_is_refused(samples, change):
    ingested = samples["ingested"]
    with pytest.raises(ValidationError, match="GroundTruth"):
        ingested.replace(truth=ingested.truth.replace(**change))
