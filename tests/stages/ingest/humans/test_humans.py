from __future__ import annotations

import numpy as np
import pytest

from schemas.config import HumansConfig, IngestConfig
from schemas.errors import InputError
from stages.evaluation.true_motion import true_positions
from stages.ingest.humans import assets, builder, human_kind, human_names, human_split
from stages.ingest.humans.builder import build_human
from stages.ingest.humans.motions import KINDS
from stages.ingest.sources import HumanSource, list_sources

CONFIG = HumansConfig(frames=4, points=500)


@pytest.fixture(autouse=True)
def one_body(body, monkeypatch):
    """Everybody has the same body, which is read once."""
    monkeypatch.setattr(builder.Body, "of", lambda shape: body)


def build(name: str = "walk-1", seed: int = 0, **settings):
    return build_human(name, CONFIG.model_copy(update=settings), np.random.default_rng(seed))


def test_every_kind_is_in_both_splits_and_ten_sequences_judge():
    names = human_names()
    judges = [name for name in names if human_split(name) == "test"]
    assert len(names) == len(set(names)) == 30
    assert len(judges) == 10
    assert {human_kind(name) for name in judges} == set(KINDS) == {human_kind(n) for n in set(names) - set(judges)}


def test_a_name_stands_for_one_motion_whatever_the_seed_which_draws_the_points():
    (frames, truth, surface), (other, _, same) = build(seed=0), build(seed=1)
    np.testing.assert_array_equal(surface.vertices, same.vertices)
    assert all(not np.allclose(a, b) for a, b in zip(frames, other, strict=True))
    assert not np.allclose(frames[0], frames[1])
    assert not np.allclose(surface.vertices, build("walk-2")[2].vertices)
    assert [len(points) for points in frames] == [len(labels) for labels in truth.labels] == [500] * 4


def test_points_lie_on_the_skin_and_noise_takes_them_off_it():
    frames, _, surface = build()
    for points, corners, weights, vertices in zip(
        frames, surface.corners, surface.weights, surface.vertices, strict=True
    ):
        np.testing.assert_allclose(np.einsum("nk,nkd->nd", weights, vertices[corners]), points)
        np.testing.assert_allclose(weights.sum(axis=1), 1)
    noisy = build(noise_percent=1.0)[0]
    diagonal = np.linalg.norm(np.ptp(surface.vertices[0], axis=0))
    assert np.std(noisy[0] - frames[0]) == pytest.approx(0.01 * diagonal, rel=0.1)


def test_the_parts_motions_lead_along_with_the_true_ones_and_the_joints_centres_are_common_to_both_parts():
    _, truth, surface = build("squat-1", points=3000)
    assert len(truth.part_names) == 16
    assert {joint.type for joint in truth.joints} == {"spherical"}
    assert sorted(joint.child for joint in truth.joints) == list(range(1, 16))
    labels, corners, weights = truth.labels[0], surface.corners[0], surface.weights[0]
    assert np.bincount(labels, minlength=16).min() > 20
    first, last = (np.einsum("nk,nkd->nd", weights, surface.vertices[t][corners]) for t in (0, 3))
    T = truth.Ts_frame_first[3][labels]
    carried = np.einsum("nij,nj->ni", T[:, :3, :3], first) + T[:, :3, 3]
    error = np.linalg.norm(carried - last, axis=1)
    assert np.median(error) < 0.2 * np.median(np.linalg.norm(last - first, axis=1))
    for joint in truth.joints:
        centre = np.append(joint.point, 1.0)
        assert np.allclose(
            truth.Ts_frame_first[:, joint.child] @ centre, truth.Ts_frame_first[:, joint.parent] @ centre, atol=0.02
        )
        assert joint.states[0] == pytest.approx(0, abs=1e-6)


def test_a_source_gives_a_sequence_with_parts_and_a_surface_of_every_kept_frame():
    sources = list_sources(IngestConfig(source="humans"), None)
    assert [source.name for source in sources] == human_names()
    assert sources[0].digest() != sources[1].digest() == HumanSource(sources[1].name).digest()
    config = IngestConfig(source="humans", humans=CONFIG, every=2)
    ingested = sources[0].load(config, np.random.default_rng(0))
    assert ingested.sequence.frame_count == 2
    assert ingested.sequence.units == "metre"
    p_true = true_positions(ingested, 1)
    assert p_true is not None
    np.testing.assert_allclose(p_true[1], ingested.sequence.frames()[1], atol=1e-12)
    flow = np.linalg.norm(p_true[1] - p_true[0], axis=1) * ingested.sequence.scale
    assert 0.01 < flow.mean() < 0.4


def test_without_the_package_the_data_set_is_refused_once(monkeypatch):
    def missing() -> str:
        raise InputError("dataset humans: the package anny is not installed; run `pip install rearticulate[humans]`")

    monkeypatch.setattr(assets, "model_version", missing)
    with pytest.raises(InputError, match=r"rearticulate\[humans\]"):
        list_sources(IngestConfig(source="humans"), None)
