import pytest
from pydantic import ValidationError

from schemas.config import IngestConfig, PipelineConfig


def test_the_configuration_survives_json():
    config = PipelineConfig.model_validate({"seed": 4, "canonical_frame": {"frames": [1, 2]}})
    assert PipelineConfig.model_validate_json(config.model_dump_json()) == config


@pytest.mark.parametrize("section", PipelineConfig.model_fields)
def test_unknown_keys_are_refused_in_every_section(section):
    values = {"surprise": 1} if section == "seed" else {section: {"surprise": 1}}
    with pytest.raises(ValidationError, match="surprise"):
        PipelineConfig.model_validate(values)


def test_a_configuration_cannot_be_changed():
    with pytest.raises(ValidationError, match="frozen"):
        PipelineConfig().flow.estimator = "other"


@pytest.mark.parametrize(
    "values",
    [
        {"seed": -1},
        {"ingest": {"units": "inch"}},
        {"ingest": {"source": "web"}},
        {"flow": {"geometric": {"nodes": 1}}},
        {"relaxed_fit": {"gumbel": {"iterations": 0}}},
        {"relaxed_fit": {"energy": {"lambda_cd": -1}}},
        {"merging": {"threshold": -0.1}},
        {"canonical_frame": {"candidates": 0}},
        {"final_fit": {"reach": 0}},
    ],
)
def test_settings_out_of_range_are_refused(values):
    with pytest.raises(ValidationError):
        PipelineConfig.model_validate(values)


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        (["metre", "m", "meters", "meter", "Metres", " M "], "metre"),
        (["centimetre", "cm", "centimeters", "CM"], "centimetre"),
        (["millimetre", "mm", "millimeters", "millimetres"], "millimetre"),
        (["unknown"], "unknown"),
    ],
)
def test_a_unit_may_be_named_as_people_do(names: list[str], unit: str) -> None:
    for name in names:
        assert IngestConfig.model_validate({"units": name}).units == unit


@pytest.mark.parametrize("name", ["inch", "s", "", "mms", "ms", 1, None, "input units"])
def test_other_units_are_refused_with_those_that_there_are(name: object) -> None:
    with pytest.raises(ValidationError, match="'metre', 'centimetre', 'millimetre' or 'unknown'"):
        IngestConfig.model_validate({"units": name})
