import math

import pytest

from pipeline.configuration.listing import all_settings
from pipeline.configuration.presets import (
    BUILT,
    DATASETS,
    FOLDER,
    dataset_presets,
    load_config,
    load_settings,
    preset_names,
)
from schemas.config import PipelineConfig, TrainFlowConfig
from schemas.errors import InputError


def refusal(presets, overrides=()):
    with pytest.raises(InputError) as caught:
        load_config(presets, overrides)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_nothing_given_means_the_defaults():
    assert load_config([]) == PipelineConfig()


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_is_valid_and_changes_something(name):
    assert load_config([name]) != PipelineConfig() or name in ("sapien", "scans")


@pytest.mark.parametrize("dataset", DATASETS)
def test_every_data_set_has_a_source_and_a_condition_of_its_own(dataset):
    source, _, condition = dataset.partition("-")
    plain, made = load_config(dataset_presets(source)), load_config(dataset_presets(dataset))
    assert made.ingest.source == plain.ingest.source
    assert (made == plain) == (not condition)
    assert bool(condition) <= (source in BUILT)


def test_an_unknown_data_set_is_refused():
    with pytest.raises(InputError, match="found 'roboart-odd', expected one of roboart, urdf"):
        dataset_presets("roboart-odd")


def test_states_are_five_with_a_little_noise_in_every_source():
    for source in BUILT:
        made = load_config(dataset_presets(f"{source}-states")).ingest.roboart
        assert (made.motion, made.frames, made.noise_percent) == ("states", 5, 0.1)


def test_roboart_is_built_in_metres_and_scans_have_no_known_unit():
    assert (load_config(["roboart"]).ingest.source, load_config(["roboart"]).ingest.units) == ("roboart", "metre")
    assert (load_config(["scans"]).ingest.source, load_config(["scans"]).ingest.units) == ("files", "unknown")


def test_paper_adds_the_published_settings_to_a_data_set():
    config = load_config(["roboart", "paper"])
    assert config.ingest.source == "roboart"
    assert (config.relaxed_fit.gumbel.iterations, config.relaxed_fit.gumbel.start) == (15000, "identity")
    assert (config.relaxed_fit.energy.lambda_emd, config.relaxed_fit.energy.emd_every) == (0.3, 5)
    assert (config.final_fit.hidden_links, config.final_fit.relabel) == (False, False)


def test_overrides_come_after_presets_and_the_last_one_wins():
    config = load_config(["paper"], ["relaxed_fit.gumbel.iterations=1", "relaxed_fit.gumbel.iterations = 7"])
    assert config.relaxed_fit.gumbel.iterations == 7
    assert config.relaxed_fit.gumbel.points == load_config(["paper"]).relaxed_fit.gumbel.points


@pytest.mark.parametrize(
    ("override", "read"),
    [
        ("seed=3", lambda c: c.seed == 3),
        ("merging.threshold=1e-3", lambda c: c.merging.threshold == 0.001),
        ("flow.estimator=mine.flow:estimate", lambda c: c.flow.estimator == "mine.flow:estimate"),
        ('flow.estimator="geometric"', lambda c: c.flow.estimator == "geometric"),
        ("canonical_frame.frames=[3, 7]", lambda c: c.canonical_frame.frames == (3, 7)),
        ("relaxed_fit.energy.lambda_cd=2", lambda c: c.relaxed_fit.energy.lambda_cd == 2.0),
        ("flow={estimator='a.b:c'}", lambda c: c.flow.estimator == "a.b:c"),
    ],
)
def test_override_values_are_toml_or_plain_text(override, read):
    assert read(load_config([], [override]))


@pytest.mark.parametrize(
    ("override", "suggestion"),
    [
        ("final_fit.iteration=3", "final_fit.iterations"),
        ("gumbel.iterations=3", "relaxed_fit.gumbel.iterations"),
        ("finalfit.points=3", "final_fit.points"),
        ("nonsense.q=3", "there are seed, ingest, flow"),
    ],
)
def test_an_unknown_setting_is_refused_with_the_nearest_known(override, suggestion):
    message = refusal([], [override])
    assert override.split("=")[0] in message
    assert suggestion in message


@pytest.mark.parametrize(
    "override",
    [
        "seed=x",
        "seed=-1",
        "seed=1.5",
        "flow=3",
        "seed.a=3",
        "final_fit.reach=0",
        "final_fit.reach=inf",
        "merging.threshold=nan",
        "ingest.units=inch",
        "relaxed_fit.gumbel=5",
        "flow.geometric.stiffness=[1, nan]",
        "flow.geometric.stiffness=[]",
        "flow.geometric.stiffness=[-1]",
        "flow.geometric.max_distance=1e400",
        "flow.geometric.max_distance=1e300",
        "flow.geometric.max_distance=1e-300",
        "flow.estimator=:",
        "flow.estimator=a:",
        "flow.estimator=:b",
        "flow.estimator=..",
        "flow.estimator=a b:c",
        "flow.estimator=a..b:c",
        "relaxed_fit.solver=../solver.py:solve",
        "relaxed_fit.alternating.points=1000000000000",
        "final_fit.part_price=nan",
        "final_fit.part_price=-inf",
        "canonical_frame.candidates=100000",
        "canonical_frame.frames=[-1]",
        "canonical_frame.frames=[2, 2]",
        "ingest.roboart.frames=1000000000",
        "ingest.roboart={frames=10000, points=1000000}",
        "ingest.roboart.depth={cameras=100, width=2000, height=2000}",
        "ingest.roboart={viewpoints=3, depth={cameras=1}}",
        "ingest.roboart.sweep_degrees=[90, 40]",
        "ingest.roboart.sweep_degrees=[0, 40]",
        "ingest.roboart.sweep_degrees=[40, 9000]",
        "seed=99999999999999999999",
        f"seed={'9' * 5000}",
        f"final_fit.points={'[' * 5000}",
        f"{'seed.' * 5000}a=1",
    ],
)
def test_a_bad_value_is_refused_and_its_setting_named(override):
    message = refusal([], [override])
    assert override.split("=")[0].split(".")[0] in message
    assert len(message) < 500


def test_every_number_of_every_setting_has_bounds():
    for schema in (PipelineConfig, TrainFlowConfig):
        for setting in all_settings(schema()):
            name, value = setting.name, setting.default
            for number in value if isinstance(value, tuple) else (value,):
                if isinstance(number, int | float) and not isinstance(number, bool):
                    bad = (10**19,) if isinstance(number, int) else (1e300, math.nan, math.inf, -math.inf)
                    for one in bad:
                        given = f"[{one}]" if isinstance(value, tuple) else one
                        with pytest.raises(InputError):
                            load_settings(schema, FOLDER, [], [f"{name}={given}"])


@pytest.mark.parametrize("value", [-1.0, 0.0, float("nan"), float("inf"), "x"])
def test_a_bad_value_of_an_option_is_refused_by_the_name_of_the_option(value):
    with pytest.raises(InputError, match=f"^--scale: found {value!r}"):
        load_config([], [], {"--scale": ("export.metres_per_unit", value), "--mesh": ("export.surface", None)})


def test_an_option_comes_after_overrides():
    assert load_config([], ["seed=1"], {"--seed": ("seed", 2)}).seed == 2


@pytest.mark.parametrize("override", ["nothing", "=3", ""])
def test_an_override_without_name_or_value_is_refused(override):
    assert "expected stage.field=value" in refusal([], [override])


def test_a_value_cannot_smuggle_in_a_second_setting():
    assert "seed" in refusal([], ["seed=1\nflow.estimator='x'"])


def test_an_unknown_preset_is_refused_with_the_known_ones():
    assert "roboart" in refusal(["robart"])


def test_a_preset_may_be_a_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("[final_fit]\niterations = 9\n")
    assert load_config(["scans", str(path)]).final_fit.iterations == 9
    path.write_text("[final_fit]\niteration = 9\n")
    assert "final_fit.iterations" in refusal([str(path)])
    for text in ("[final_fit\n", f"seed = {'[' * 5000}", f"seed = {'9' * 5000}"):
        path.write_text(text)
        assert "not TOML" in refusal([str(path)])
    assert "cannot be read" in refusal([str(tmp_path / "none.toml")])
