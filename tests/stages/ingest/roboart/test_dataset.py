from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from schemas.config import IngestConfig
from schemas.errors import InputError, UnavailableError
from stages.ingest.roboart import robot_names
from stages.ingest.sources import list_sources


@pytest.fixture(autouse=True)
def no_assets(monkeypatch):
    monkeypatch.delenv("REART_ASSETS", raising=False)


@pytest.fixture
def assets(arm, tmp_path):
    """A folder that holds one arm under the names of two robots."""
    for name in ("nao", "spot"):
        (tmp_path / "assets" / name).mkdir(parents=True)
        (tmp_path / "assets" / name / f"{name}.urdf").write_bytes(arm.read_bytes())
    return tmp_path / "assets"


def config(**roboart) -> IngestConfig:
    return IngestConfig(source="roboart", roboart={"frames": 3, "points": 64, "novel_states": 1} | roboart)


def by_name(assets: Path | None, **roboart):
    return {source.name: source for source in list_sources(config(**roboart), assets)}


def loaded(source, seed=0, **roboart):
    return source.load(config(**roboart), np.random.default_rng(seed))


def test_every_robot_is_listed_whether_it_is_there_or_not():
    assert list(by_name(None)) == robot_names()


def test_a_robot_that_is_not_there_is_told_by_its_digest_and_does_not_hinder_another(assets):
    sources = by_name(assets)
    assert len(sources["nao"].digest()) == 64
    with pytest.raises(UnavailableError, match="'nao'"):
        by_name(None)["nao"].digest()
    with pytest.raises(UnavailableError, match="'nao'"):
        loaded(by_name(None)["nao"])


def test_the_folder_is_the_one_given_or_else_the_environments(assets, monkeypatch):
    monkeypatch.setenv("REART_ASSETS", str(assets))
    assert by_name(None)["nao"].digest() == by_name(assets)["nao"].digest()
    monkeypatch.setenv("REART_ASSETS", "")
    assert by_name(None)["nao"].assets is None


def test_a_folder_without_any_robot_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"NAME/NAME\.urdf") as caught:
        by_name(tmp_path / "absent")
    assert str(tmp_path / "absent") in str(caught.value)


def test_sequences_of_one_robot_are_counted_and_differ(assets):
    sources = by_name(assets, sequences_per_robot=3)
    assert list(sources)[:3] == ["a1-0", "a1-1", "a1-2"]
    assert len(sources) == 54
    assert len({sources[f"nao-{index}"].digest() for index in range(3)}) == 3
    first, second = (loaded(sources[f"nao-{index}"]) for index in range(2))
    assert not np.allclose(first.truth.Ts_frame_first, second.truth.Ts_frame_first)


def test_a_sequence_stays_the_same_however_many_there_are(assets):
    alone, among = by_name(assets)["nao"], by_name(assets, sequences_per_robot=3)["nao-0"]
    np.testing.assert_array_equal(loaded(alone).sequence.points, loaded(among).sequence.points)


def test_two_robots_move_differently_under_one_seed(assets):
    sources = by_name(assets)
    one, other = loaded(sources["nao"]), loaded(sources["spot"])
    assert not np.allclose(one.truth.Ts_frame_first, other.truth.Ts_frame_first)


def test_the_same_seed_gives_the_same_sequence_and_another_seed_another(assets):
    source = by_name(assets)["nao"]
    first, again, other = (loaded(source, seed).sequence.points.tobytes() for seed in (0, 0, 1))
    assert first == again != other
