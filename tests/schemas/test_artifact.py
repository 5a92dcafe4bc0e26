"""Laws that every schema obeys."""

from typing import Annotated

import numpy as np
import pytest
from jaxtyping import Float64
from pydantic import ValidationError

from pipeline.store.arrays import assemble, payload_of
from schemas.artifact import Artifact, Unit


def fields(artifact):
    return {name: getattr(artifact, name) for name in type(artifact).model_fields}


def refusal(artifact, **changes):
    with pytest.raises(ValidationError) as caught:
        artifact.replace(**changes)
    return str(caught.value)


def test_an_artifact_is_made_again_from_its_fields(sample):
    again = type(sample).model_validate(fields(sample))
    assert payload_of(again) == payload_of(sample)
    assert all(again.arrays()[name] is array for name, array in sample.arrays().items())


def test_unknown_fields_are_refused(sample):
    assert "extra" in refusal(sample, surprise=1)


def test_an_artifact_cannot_be_changed(sample):
    name = next(iter(type(sample).model_fields))
    with pytest.raises(ValidationError, match="frozen"):
        setattr(sample, name, getattr(sample, name))


def test_every_required_field_is_missed(sample):
    for name, field in type(sample).model_fields.items():
        if field.is_required():
            values = fields(sample)
            del values[name]
            with pytest.raises(ValidationError, match=name):
                type(sample).model_validate(values)


def test_arrays_of_the_wrong_kind_are_refused_by_name(sample):
    for name, array in sample.arrays().items():
        where = f"{type(sample).__name__}.{name}"
        other = np.int64 if array.dtype.kind == "f" else np.float64
        assert where in refusal(sample, **{name: array.astype(other)})
        assert where in refusal(sample, **{name: array[None]})
        assert where in refusal(sample, **{name: array.tolist()})


def test_values_that_are_not_finite_are_refused_and_counted(sample):
    for name, array in sample.arrays().items():
        if array.dtype.kind == "f" and array.size:
            for bad in (np.nan, np.inf):
                changed = array.copy()
                changed.flat[-1] = bad
                assert f"{name}: 1 values" in refusal(sample, **{name: changed})


def test_axes_of_one_name_have_one_size(sample):
    there = [spec for spec in sample.array_specs() if spec.name in sample.arrays()]
    for spec in there:
        array = sample.arrays()[spec.name]
        for axis, dim in enumerate(spec.dims):
            shared = any(dim in other.dims for other in there if other.name != spec.name)
            if shared or dim.isdigit():
                longer = np.concatenate([array, np.take(array, [-1], axis=axis)], axis=axis) if array.size else None
                if longer is not None:
                    assert dim in refusal(sample, **{spec.name: longer})


def test_both_halves_of_an_artifact_make_it_whole(sample):
    from pipeline.store.arrays import arrays_of

    again = assemble(type(sample), payload_of(sample), {path: array for path, _, array in arrays_of(sample)})
    assert payload_of(again) == payload_of(sample)


def test_an_array_field_must_state_its_unit():
    class Careless(Artifact):
        values: Float64[np.ndarray, "rows"]

    with pytest.raises(TypeError, match=r"Careless\.values"):
        Careless.array_specs()


def test_an_optional_array_may_be_left_out():
    class Lenient(Artifact):
        values: Annotated[Float64[np.ndarray, "rows"] | None, Unit("1")] = None

    assert Lenient().arrays() == {}
    assert list(Lenient(values=np.zeros(2)).arrays()) == ["values"]
