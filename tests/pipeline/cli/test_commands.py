import functools
import inspect
import io
import json
import math
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.cli.tables import model_table, screen_table
from pipeline.cli.train_flow import train_flow
from pipeline.configuration.presets import FOLDER, TRAINING_FOLDER, load_settings
from pipeline.results.delivery import deliver
from pipeline.results.report_tables import Cell, Row, Table
from schemas.assessment import Spread
from schemas.config import PipelineConfig, TrainFlowConfig

DATA = ("--dataset", "scans", "--data", "data")


@pytest.fixture
def reart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data" / "box").mkdir(parents=True)
    for t in range(2):
        np.save(tmp_path / "data" / "box" / f"{t}.npy", np.random.default_rng(t).normal(size=(40, 3)))
    (tmp_path / "file").write_text("")
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("fit", "data/box", "--out", "file"), "--out file: found a file"),
        (("fit", "data/box", "--out", "file/below"), "--out file/below"),
        (("fit", "data/box", "--out", "/proc/nothing"), "--out /proc/nothing"),
        (("fit", "data/box", "--out", "out", "--units", "inch"), "--units: found 'inch'"),
        (("fit", "data/box", "--out", "out", "--set", "final_fit.iteration=1"), "final_fit.iterations"),
        (("fit", "data/box", "--out", "out", "--preset", "papre"), "papre"),
        (("fit", "data/box", "--out", "out", "--truth", "nowhere"), "--truth nowhere: found no ground truth"),
        (("run", "--dataset", "robart"), "roboart, urdf, roboart-noisy"),
        (("run", *DATA, "--workdir", "file"), "--workdir file"),
        pytest.param(
            ("run", "--dataset", "humans", "--sequences", "fly-1"),
            "expected some of walk-1, walk-2",
            marks=pytest.mark.skipif(find_spec("anny") is None, reason="the package anny is not installed"),
        ),
        (("run", "--dataset", "dfaust", "--data", "file"), "file: is no HDF5 file"),
        (("run", "--dataset", "dfaust", "--data", "data"), "ingest.correspond=true"),
        (("run", "--dataset", "dfaust"), "registrations (.hdf5)"),
        (("rerun", "flow", *DATA, "--sequence", "box", "--set", "flow"), "stage.field=value"),
        (("evaluate", *DATA, "--split", "test"), "no splits"),
        (("evaluate", *DATA, "--out", "file"), "--out file: found a file"),
        (("evaluate", *DATA, "--against", "nowhere"), "nowhere: cannot be read"),
        (("evaluate", *DATA, "--against", "file"), "file: the file"),
        (("status", "--dataset", "scans"), "ingest.source"),
        (("status", "--dataset", "scans", "--data", "nowhere"), "nowhere"),
        (("inspect", "data/box"), "manifest.json"),
        (("inspect", "nowhere"), "nowhere"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_exit_code_2_before_anything_is_computed(reart, tmp_path, words, complaint):
    result = reart(*words)
    assert result.exit_code == 2
    [error] = result.stderr.splitlines()
    assert error.startswith("error: ")
    assert complaint in error
    assert not list(tmp_path.glob("**/manifest.json"))


def test_a_sequence_that_a_file_of_registrations_lacks_is_told_with_those_that_it_has(reart, tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "registrations_m.hdf5", "w") as file:
        file["50004_hopping"] = np.zeros((40, 3, 5))
    words = ("run", "--dataset", "dfaust", "--data", "registrations_m.hdf5", "--sequences", "50004_hoping")
    result = reart(*words)
    assert result.exit_code == 2
    assert result.stderr.splitlines() == [
        "error: sequences: found 50004_hoping, expected some of 50004_hopping; check the spelling"
    ]


def test_an_npz_whose_points_do_not_correspond_is_one_line_and_exit_code_2(reart, tmp_path):
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "scans.npz", *(rng.normal(size=(40 + t, 3)) for t in range(3)))
    result = reart("fit", "scans.npz", "--out", "out", "--set", "ingest.correspond=true")
    assert result.exit_code == 2
    assert "found 40 points in scans.npz[arr_0] and 41 in scans.npz[arr_1]" in " ".join(result.stderr.split())


def test_status_of_what_was_never_run_is_missing_everywhere(reart):
    result = reart("status", *DATA)
    assert result.exit_code == 0
    assert "box" in result.stdout
    assert result.stdout.count("missing") == 13


@pytest.mark.parametrize(
    "command", ["fit", "run", "evaluate", "status", "inspect", "rerun", "figure", "export", "pose"]
)
def test_every_command_explains_itself_with_an_example(reart, command):
    result = reart(command, "--help")
    assert result.exit_code == 0
    assert f"reart {command}" in result.stdout.split("Example")[1]


ROOT = Path(__file__).parents[3]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def examples():
    """Every setting that a help text or a document gives as an example, with the schema that knows it."""
    texts = [(PipelineConfig, FOLDER, document.read_text(encoding="utf-8")) for document in DOCUMENTS]
    for command in app.registered_commands:
        schema, folder = (
            (TrainFlowConfig, TRAINING_FOLDER) if command.callback is train_flow else (PipelineConfig, FOLDER)
        )
        texts.append((schema, folder, inspect.getdoc(command.callback)))
    for schema, folder, text in texts:
        for setting in re.findall(r"--set ([a-z_.]+=[^`\s\"]+)", text):
            of_pipeline = setting.startswith("flow.") or schema is PipelineConfig
            yield (PipelineConfig, FOLDER, setting) if of_pipeline else (schema, folder, setting)


def test_there_are_examples():
    assert len(list(examples())) > 8


@pytest.mark.parametrize(("schema", "folder", "setting"), list(examples()))
def test_every_setting_in_an_example_is_known_accepted_and_no_default(schema, folder, setting):
    assert load_settings(schema, folder, [], [setting]) != schema()
    name, _, value = setting.partition("=")
    default = functools.reduce(getattr, name.split("."), schema())
    if isinstance(default, int | float) and not isinstance(default, bool):  # an example shows a change one may want
        assert default / 10 <= float(value) <= 10 * max(default, 1)


def test_the_example_in_a_refusal_is_one(reart):
    refusal = reart("run", "--dataset", "scans", "--set", "flow").stderr
    setting = re.search(r"as in (\S+=\S+)", refusal)[1]
    assert load_settings(PipelineConfig, FOLDER, [], [setting]) != PipelineConfig()


def test_the_command_line_starts_without_the_heavy_libraries():
    program = "import sys, pipeline.cli; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert not {"torch", "open3d", "zarr", "luigi", "scipy", "matplotlib"} & set(done.stdout.split())


def cells(table, row):
    return {str(column.header): list(column.cells)[row] for column in table.columns}


def test_joints_are_shown_with_their_parts_and_range(samples):
    row = cells(model_table(samples["result"].model), 0)
    assert (row["parent"], row["child"], row["type"], row["range"]) == ("part_0", "part_1", "spherical", "0 .. 0.5 rad")


@pytest.mark.parametrize(
    ("spread", "shown"),
    [
        (Spread(direction=math.radians(0.314), place=0.00217), "0.31°, 0.0022 input units"),
        (Spread(direction=math.radians(12.34)), "12°"),
        (None, ""),
    ],
)
def test_the_spread_of_a_joint_is_shown_with_two_digits(samples, spread, shown):
    model = samples["result"].model
    joint = model.joints[0].model_copy(update={"spread": spread})
    assert cells(model_table(model.model_copy(update={"joints": (joint,)})), 0)["spread"] == shown


def test_a_line_parts_the_sections_and_no_text_is_taken_for_markup():
    rows = (Row("a", (Cell("[odd]"),)), Row("mean", (Cell("+1 ▲", "better"),), section="all"))
    table = screen_table(Table("[title]", ("name", "value"), rows))
    screen = io.StringIO()
    Console(file=screen, width=60, color_system=None).print(table)
    shown = screen.getvalue()
    assert "[odd]" in shown
    assert shown.index("[odd]") < shown.index("mean")
    assert [row.end_section for row in table.rows] == [True, False]
    assert "[green]" in cells(table, 1)["value"]


def test_inspect_tells_whether_delivered_files_are_as_they_were_written(reart, tmp_path):
    (tmp_path / "filled").mkdir()
    deliver(tmp_path / "filled", {"model.json": b"{}", "robot.urdf": b"<robot/>"})
    whole = reart("inspect", "filled")
    assert (whole.exit_code, whole.stdout) == (0, "every file is as it was written\n")
    (tmp_path / "filled" / "robot.urdf").write_bytes(b"<robot />")
    changed = reart("inspect", "filled")
    assert (changed.exit_code, changed.stdout.startswith("changed: robot.urdf: ")) == (1, True)
    assert json.loads(reart("inspect", "filled", "--json").stdout)["problems"]
