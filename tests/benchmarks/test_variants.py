import pytest

from pipeline.configuration.presets import load_config
from schemas.scores import MEASURES


@pytest.fixture
def variants(load_benchmark):
    return load_benchmark("variants")


def test_every_variant_is_a_configuration_of_its_own(variants):
    default = load_config(["roboart"])
    configs = {name: load_config(["roboart"], settings) for name, settings in variants.VARIANTS.items()}
    same = {name for name, config in configs.items() if config == default}
    assert same == {"as it is", "flow by hybrid"}


def test_measures_that_are_shown_exist(variants):
    assert set(variants.MEASURES) <= set(MEASURES)


def test_an_unknown_set_is_refused(variants, tmp_path, capsys):
    assert variants.main(["nothing", "--workdir", str(tmp_path)]) == 2
    assert "set 'nothing': not found, expected one of" in capsys.readouterr().err
