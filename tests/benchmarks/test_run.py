import importlib.util
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from pipeline.configuration.presets import dataset_presets, load_config
from pipeline.store import artifacts
from schemas.errors import InputError
from schemas.manifest import Provenance
from schemas.scores import Scores

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "run.py"


@pytest.fixture(scope="module")
def benchmark():
    specification = importlib.util.spec_from_file_location("benchmark_run", SCRIPT)
    module = importlib.util.module_from_spec(specification)
    sys.modules["benchmark_run"] = module
    specification.loader.exec_module(module)
    yield module
    del sys.modules["benchmark_run"]


@pytest.fixture
def record(benchmark):
    evaluation = Scores(dataset="roboart", created=datetime.now(UTC), config={}, sequences=(), missing=(), groups=())
    return benchmark.Record(
        name="three",
        set=benchmark.read_set("three"),
        date=datetime(2026, 1, 2, 3, 4, tzinfo=UTC),
        commit="0123",
        machine=benchmark.machine(),
        packages={"numpy": "2"},
        workers=2,
        exit_code=0,
        wall_seconds=100.0,
        stage_seconds=190.0,
        evaluation=evaluation,
    )


@pytest.mark.parametrize("path", sorted((SCRIPT.parent / "sets").glob("*.toml")), ids=lambda path: path.stem)
def test_every_set_can_be_read_and_its_settings_exist(benchmark, path):
    chosen = benchmark.read_set(path.stem)
    load_config([*dataset_presets(chosen.dataset), *([chosen.preset] if chosen.preset else [])], chosen.settings)
    assert chosen.description


def test_an_unknown_set_is_refused_with_the_known_ones(benchmark, capsys):
    assert benchmark.main(["tree", "--workdir", "w"]) == 2
    assert "three" in capsys.readouterr().err


def test_a_set_of_robots_that_no_package_ships_asks_for_assets(benchmark, monkeypatch, tmp_path):
    monkeypatch.delenv("REART_ASSETS", raising=False)
    with pytest.raises(InputError, match="--assets"):
        benchmark.run("roboart", benchmark.read_set("roboart"), tmp_path, 1, None)


def test_a_set_becomes_the_words_of_a_run(benchmark):
    chosen = benchmark.BenchmarkSet(
        description="x", dataset="roboart", sequences=("a1", "ur5"), preset="paper", settings=("flow.x=1",), seed=3
    )
    words = " ".join(benchmark.command(chosen, Path("w"), 2, Path("d")))
    assert words == (
        "run --dataset roboart --workdir w --workers 2 --seed 3 --data d "
        "--sequences a1,ur5 --preset paper --set flow.x=1"
    )


def test_overhead_is_the_share_of_the_workers_time_that_went_into_no_stage(record):
    assert record.overhead == pytest.approx(0.05)
    assert record.model_copy(update={"stage_seconds": 0.0}).overhead is None


def test_time_in_stages_is_that_of_the_artifacts_made_since(benchmark, samples, tmp_path):
    start = datetime(2026, 1, 1, tzinfo=UTC)
    for day in range(3):
        provenance = Provenance(
            stage="evaluation",
            version=1,
            dataset="roboart",
            sequence="bolt",
            key=f"{day}",
            parameters={},
            config={},
            upstream={},
            seed=0,
            created=start + timedelta(days=day),
            seconds={"read": 0.5, "compute": 3.0},
            packages={},
        )
        artifacts.publish(tmp_path / "bolt" / f"evaluation-{day}", samples["metrics"], provenance)
    assert benchmark.stage_seconds(tmp_path, start + timedelta(days=1)) == pytest.approx(7.0)
    assert benchmark.stage_seconds(tmp_path, start + timedelta(days=3)) == 0


def test_a_record_survives_its_file_and_its_markdown_names_machine_and_commit(benchmark, record, tmp_path):
    json_path, markdown_path = benchmark.write(record, None, tmp_path / "results")
    assert json_path.name == "three-2026-01-02-0304.json"
    assert benchmark.read_record(json_path) == record
    markdown = markdown_path.read_text()
    assert record.machine.processor in markdown
    assert "| overhead | 5.0% |" in markdown
    with pytest.raises(InputError, match="not a record"):
        benchmark.read_record(markdown_path)


def test_this_machine_is_described(benchmark):
    found = benchmark.machine()
    assert found.processor
    assert found.cores >= 1
    assert found.memory_gib > 0
