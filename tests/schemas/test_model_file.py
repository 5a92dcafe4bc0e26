import json

import pytest
from pydantic import ValidationError

from schemas.model_file import ModelFile


def test_model_json_survives_and_keeps_its_contract(samples):
    model = samples["result"].model
    text = model.model_dump_json()
    assert ModelFile.model_validate_json(text) == model
    content = json.loads(text)
    assert (content["format"], content["version"]) == ("rearticulate/model", 1)
    assert list(content) == [
        "format", "version", "units", "frames", "canonical_frame", "root", "parts", "joints",
    ]  # fmt: skip
    assert list(content["parts"][0]) == ["id", "name", "point_count"]
    assert list(content["joints"][0]) == [
        "id", "name", "parent", "child", "type", "axis", "point", "lower", "upper", "confidence", "states",
    ]  # fmt: skip


def test_confidence_is_optional_and_between_none_and_all(samples):
    content = json.loads(samples["result"].model.model_dump_json())
    del content["joints"][0]["confidence"]  # as in files of earlier releases
    assert ModelFile.model_validate(content) == samples["result"].model
    content["joints"][0]["confidence"] = {"part": 0.0, "link": 0.25, "type": 1.0}
    assert ModelFile.model_validate(content).joints[0].confidence.link == 0.25
    content["joints"][0]["confidence"]["part"] = 1.5
    with pytest.raises(ValidationError):
        ModelFile.model_validate(content)


@pytest.mark.parametrize(
    "change", [{"version": 2}, {"format": "other"}, {"frames": 0}, {"units": "inch"}, {"extra": 1}]
)
def test_other_formats_are_refused(samples, change):
    content = json.loads(samples["result"].model.model_dump_json())
    with pytest.raises(ValidationError):
        ModelFile.model_validate(content | change)


def test_states_are_numbers_or_rotation_vectors(samples):
    content = json.loads(samples["result"].model.model_dump_json())
    for states in ([0.0, 0.1, 0.2], [[0.0, 0.1, 0.2]] * 3):
        content["joints"][0]["states"] = states
        assert json.loads(ModelFile.model_validate(content).model_dump_json())["joints"][0]["states"] == states
    content["joints"][0]["states"] = [[0.0, 0.1]] * 3
    with pytest.raises(ValidationError):
        ModelFile.model_validate(content)
