"""`reart settings` lists what can be set."""

import json


def test_the_common_settings_are_listed_with_defaults_and_meanings(reart):
    shown = reart("settings").stdout
    assert "final_fit.part_price" in shown
    assert "30.0" in shown
    assert "is joined to a neighbour" in shown
    assert "link_tolerance" not in shown


def test_advanced_ones_are_listed_where_they_are_asked_for(reart):
    assert "final_fit.link_tolerance" in reart("settings", "--advanced").stdout


def test_a_section_is_listed_whole(reart):
    names = [entry["name"] for entry in json.loads(reart("settings", "relaxed_fit.alternating", "--json").stdout)]
    assert "relaxed_fit.alternating.reach" in names
    assert all(name.startswith("relaxed_fit.alternating.") for name in names)


def test_a_single_setting_is_a_section_too(reart):
    [entry] = json.loads(reart("settings", "projection.joints", "--json").stdout)
    assert entry == {
        "name": "projection.joints",
        "default": ["revolute", "prismatic"],
        "meaning": entry["meaning"],
        "tier": "common",
    }


def test_a_section_that_there_is_not_is_one_line(reart):
    result = reart("settings", "final_fat")
    assert result.exit_code == 2
    [error] = result.stderr.splitlines()
    assert "found 'final_fat', expected one of" in error
    assert "final_fit" in error
