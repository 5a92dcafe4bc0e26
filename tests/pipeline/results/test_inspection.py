import numpy as np
import pytest

from pipeline.results.inspection import inspect
from pipeline.store import artifacts
from schemas.manifest import Provenance


@pytest.fixture
def stored(tiny, samples, tmp_path):
    """Artifacts of several schemas, each under the name of its sample."""
    first, *_ = tiny.finish(tiny.job())
    places = {}
    for name, sample in samples.items():
        places[name] = tmp_path / name / first.directory.name
        artifacts.publish(places[name], sample, provenance(first.directory))
    return places


def provenance(directory):
    values = artifacts.read_manifest(directory).model_dump(include=set(Provenance.model_fields))
    return Provenance.model_validate(values)


def test_the_arrays_of_an_artifact_are_described(stored, samples):
    report = inspect(stored["ingested"])
    arrays = {array.entry.name: array for array in report.arrays}
    points = samples["ingested"].sequence.points
    described = arrays["sequence/points"]
    assert (described.entry.shape, described.entry.dtype) == (points.shape, "float64")
    assert (described.minimum, described.maximum, described.nan_count) == (points.min(), points.max(), 0)
    assert arrays["truth/Ts_novel_first"].minimum is None  # empty
    assert report.problems == ()


def test_energies_are_found_wherever_they_are(stored):
    assert inspect(stored["kinematic"]).energies == {"E_project": 0.1 + 0.2, "E_group": np.inf}
    assert inspect(stored["relaxed"]).energies == {"E_recons": 3.0, "E_CD": 1.0, "E_EMD": 1.0, "E_flow": 1.0}
    assert inspect(stored["choice"]).energies["frame 1: E_project + E_group"] == 0.1 + 0.2
    assert inspect(stored["choice"]).energies["model.E_group"] == np.inf


def test_a_solvers_own_energy_keeps_its_name(stored, samples):
    own = samples["relaxed"].replace(energy_history=np.array([[5.0], [4.0]]), energy_names=("E_own",))
    directory = stored["relaxed"].parent / "own" / stored["relaxed"].name
    artifacts.publish(directory, own, provenance(stored["relaxed"]))
    assert inspect(directory).energies == {"E_own": 4.0}


def test_what_is_corrupt_is_named_and_the_rest_still_shown(stored):
    chunk = stored["flow"] / "arrays.zarr" / "flow" / "c" / "0" / "0"
    chunk.write_bytes(b"x" + chunk.read_bytes()[1:])
    report = inspect(stored["flow"])
    assert len(report.problems) == 2  # the file, and the array in it
    assert all("flow" in problem for problem in report.problems)
    described = {array.entry.name: array.maximum for array in report.arrays}
    assert described["flow"] is None
    assert described["target_index"] == 3


def test_a_corrupt_manifest_is_all_that_is_told(stored):
    (stored["flow"] / "manifest.json").write_text("{")
    report = inspect(stored["flow"])
    assert report.manifest is None
    assert len(report.problems) == 1
