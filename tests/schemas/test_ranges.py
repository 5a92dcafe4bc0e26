"""Indices name something that is there, and motions are rigid, in every artifact."""

import numpy as np
import pytest
from pydantic import ValidationError

from schemas.artifact import Rigid, Within


def rules(artifact, kind):
    fields = type(artifact).model_fields.items()
    return {name: rule for name, field in fields for rule in field.metadata if isinstance(rule, kind)}


def refusal(artifact, **changes):
    with pytest.raises(ValidationError) as caught:
        artifact.replace(**changes)
    return str(caught.value.errors()[0]["msg"])


def test_what_lies_out_of_its_range_is_refused_by_name(sample):
    for name, rule in rules(sample, Within).items():
        value = getattr(sample, name)
        if not np.size(value) or value is None:
            continue
        for bad in (rule.least - 1, 10**9 if isinstance(rule.most, str) else rule.most * 2):
            changed = np.array(value)
            changed.flat[-1] = bad
            given = changed if isinstance(value, np.ndarray) else int(bad)
            assert f"{type(sample).__name__}.{name}: found " in refusal(sample, **{name: given})


def test_what_moves_no_thing_rigidly_is_refused_by_name(sample):
    for name in rules(sample, Rigid):
        Ts = getattr(sample, name)
        if not Ts.size:
            continue
        for entry, value in (((0, 0), 2.0), ((0, 0), -1.0), ((0, 1), 0.1), ((3, 0), 1.0), ((3, 3), 0.0), ((1, 1), 1e9)):
            changed = Ts.copy()
            changed[(..., *entry)] = value
            assert f"{type(sample).__name__}.{name}: found others than rigid" in refusal(sample, **{name: changed})


def test_every_float_has_a_greatest_size(sample):
    for name, array in sample.arrays().items():
        if array.dtype.kind == "f" and array.size:
            assert f"{name}: found a number of size 1e+30" in refusal(sample, **{name: np.full_like(array, 1e30)})


def test_every_index_states_its_range(sample):
    for spec in sample.array_specs():
        if spec.unit in ("index", "count") and type(sample).__name__ != "Robot":
            assert spec.name in rules(sample, Within)


def test_matches_add_up_to_their_counts(samples):
    assert "Flow.match_counts: found a sum of 3, expected 4" in refusal(samples["flow"], match_counts=np.array([1, 2]))


def test_true_parts_hang_on_each_other_in_a_tree(samples):
    truth = samples["ingested"].truth
    assert "GroundTruth.parent: found a loop" in refusal(truth, parent=np.array([1, 0]))
    stray = truth.joints[0].model_copy(update={"child": 2})
    assert "GroundTruth.joints: hinge links 0 and 2" in refusal(truth, joints=(stray,))


def test_an_axis_has_unit_length(samples):
    assert "KinematicModel.axis" in refusal(samples["kinematic"], axis=np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 0.0]]))


def test_a_result_is_as_large_as_its_model(samples):
    result = samples["result"]
    assert "Result.T_frame_canonical" in refusal(result, T_frame_canonical=result.T_frame_canonical[:2])


def test_a_scale_and_a_centre_are_finite(samples):
    for change in ({"scale": np.inf}, {"centre": (0.0, np.nan, 0.0)}):
        assert "finite" in refusal(samples["sequence"], **change)
