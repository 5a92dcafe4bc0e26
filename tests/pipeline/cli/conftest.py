"""A small model in a folder, and the command line in it."""

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from schemas.kinematic import KinematicModel
from stages.result.stage import compute_result, result_files


@pytest.fixture
def model(samples, tmp_path):
    """A chain of three parts, hinge and slider, in a result folder."""
    rng = np.random.default_rng(0)
    sequence = samples["sequence"].replace(points=rng.normal(size=(900, 3)), point_counts=np.array([300] * 3))
    kinematic: KinematicModel = samples["kinematic"].replace(labels=np.repeat([0, 1, 2], 100), energies={})
    folder = tmp_path / "chain"
    folder.mkdir()
    for name, content in result_files(compute_result(kinematic, sequence)).items():
        (folder / name).write_bytes(content)
    return folder


@pytest.fixture
def reart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
