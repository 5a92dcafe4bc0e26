"""Every setting is listed by the name that `--set` takes, with what it means."""

import pytest

from pipeline.configuration.listing import Setting, all_settings
from pipeline.configuration.presets import load_config
from schemas.config import PipelineConfig, TrainFlowConfig
from schemas.settings import COMMON
from stages.flow.stage import ESTIMATORS
from stages.relaxed_fit.stage import SOLVERS

SETTINGS = {setting.name: setting for setting in all_settings()}


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=SETTINGS)
def test_a_default_as_it_is_shown_changes_nothing(setting):
    if setting.default is not None:
        assert load_config([], [f"{setting.name}={setting.shown}"]) == PipelineConfig()


@pytest.mark.parametrize("schema", [PipelineConfig, TrainFlowConfig])
def test_every_setting_has_a_meaning(schema):
    assert [setting.name for setting in all_settings(schema()) if not setting.meaning] == []


def test_the_common_ones_are_few():
    assert COMMON == "common"
    common = {name for name, setting in SETTINGS.items() if not setting.advanced}
    assert {"seed", "ingest.units", "projection.joints", "final_fit.part_price"} <= common
    assert len(common) <= 26


def test_what_other_data_may_need_is_an_advanced_setting():
    names = {
        "relaxed_fit.alternating.reach_first": 5.0,
        "relaxed_fit.alternating.reach": 3.0,
        "relaxed_fit.alternating.reach_last": 2.0,
        "final_fit.link_tolerance": 0.25,
        "final_fit.link_explains": 0.6,
        "final_fit.pair_directions": 6,
        "final_fit.joint_samples": 60,
        "final_fit.contact": 2.0,
        "final_fit.settled": 0.003,
        "export.farthest": 3.0,
    }
    assert {name: SETTINGS[name].default for name in names} == names
    assert all(SETTINGS[name].advanced for name in names)


def test_the_registered_functions_are_named():
    assert all(name in SETTINGS["flow.estimator"].meaning for name in ESTIMATORS)
    assert all(name in SETTINGS["relaxed_fit.solver"].meaning for name in SOLVERS)


def test_none_is_shown_as_such():
    assert Setting("weights", None, "", advanced=True).shown == "none"


def test_one_weight_of_the_reported_energy_leaves_the_others():
    changed = load_config([], ["final_fit.energy.lambda_cd=2.0"]).final_fit.energy
    assert changed == PipelineConfig().final_fit.energy.model_copy(update={"lambda_cd": 2.0})
