import pytest

from schemas.config import ExportConfig
from stages.export.remarks import remarks
from stages.export.stage import compute_export


@pytest.fixture
def model(samples):
    return samples["result"].model


def test_of_most_models_there_is_nothing_to_say(model):
    assert remarks(model, None, 0.5, 4.0) == ()


@pytest.mark.parametrize(
    ("units", "scale", "size", "mass", "words"),
    [
        ("unknown", None, 300.0, 4e9, "unit unknown: one unit was taken for one metre: the robot is 300 m long and 4e"),
        ("unknown", None, 8.0, 2e5, "unit unknown"),
        ("millimetre", None, 0.0005, 1e-9, "the unit was said to be the millimetre: the robot is 0.0005 m long"),
        ("metre", 100.0, 30.0, 1.0, "one unit was said to be 100 m"),
    ],
)
def test_an_absurd_size_or_mass_is_told_with_what_to_say(model, units, scale, size, mass, words):
    [line] = remarks(model.model_copy(update={"units": units}), scale, size, mass)
    assert words in line
    assert "--units" in line


def test_a_description_has_its_remarks(hinge, fit_of):
    result = fit_of(hinge)
    in_millimetres = result.model.model_copy(update={"units": "unknown"})
    assert compute_export(result, None, ExportConfig(triangles=50), "box").remarks == ()
    config = ExportConfig(triangles=50, metres_per_unit=1000.0)
    [line] = compute_export(result.replace(model=in_millimetres), None, config, "box").remarks
    assert "kg heavy" in line
