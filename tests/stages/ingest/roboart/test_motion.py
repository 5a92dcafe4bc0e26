from __future__ import annotations

import numpy as np
import pytest

from schemas.config import RoboartConfig
from stages.ingest.roboart.motion import draw_sweep, draw_unseen, drive_ranges, movable_joints, search
from stages.ingest.roboart.penetration import penetration_score
from stages.ingest.roboart.surface import Surface, link_triangles
from stages.ingest.roboart.urdf import read_urdf

WIDE = np.radians([-90.0, 90.0])


def sweeps(kind, limits, frames=10):
    rng = np.random.default_rng(1)
    return [draw_sweep(kind, np.array(limits), RoboartConfig(frames=frames), rng) for _ in range(200)]


def test_a_revolute_joint_moves_forty_to_ninety_degrees_in_all():
    totals = np.degrees([np.abs(np.diff(path)).sum() for path in sweeps("revolute", WIDE)])
    assert totals.min() >= 40 - 1e-9
    assert totals.max() <= 90 + 1e-9
    assert np.ptp(totals) > 40


@pytest.mark.parametrize("frames", [2, 3, 10])
def test_a_joint_turns_back_at_most_once_and_never_stands_still(frames):
    paths = sweeps("revolute", WIDE, frames)
    turns = np.array([(np.diff(np.sign(np.diff(path))) != 0).sum() for path in paths])
    assert min(np.abs(np.diff(path)).min() for path in paths) > 0
    assert set(turns) == ({0} if frames == 2 else {0, 1})
    assert {bool(path[1] > path[0]) for path in paths} == {True, False}


def test_a_joint_of_little_range_uses_most_of_it_and_keeps_its_limits():
    for path in sweeps("revolute", [0.2, 0.5]):
        assert path.min() >= 0.2
        assert path.max() <= 0.5
        assert np.ptp(path) == pytest.approx(0.9 * 0.3)


def test_a_prismatic_joint_sweeps_most_of_its_range_within_its_limits():
    for path in sweeps("prismatic", [-0.3, -0.1]):
        assert path.min() >= -0.3
        assert path.max() <= -0.1
        assert 0.7 * 0.2 - 1e-12 <= np.ptp(path) <= 0.9 * 0.2 + 1e-12


def test_unseen_states_lie_near_the_sweep_and_within_the_limits():
    rng = np.random.default_rng(0)
    drawn = np.array([draw_unseen(np.array([-0.1, 5.0]), np.array([0.0, 1.0]), rng) for _ in range(500)])
    assert -0.1 <= drawn.min() < 0
    assert 1 < drawn.max() <= 1.25


def test_a_leading_joint_keeps_the_limits_of_the_joint_that_mimics_it(arm):
    robot = read_urdf(arm)
    ranges = dict(zip([joint.name for joint in robot.joints], drive_ranges(robot), strict=True))
    np.testing.assert_allclose(ranges["shoulder"], [0.3, 2.2])
    np.testing.assert_allclose(ranges["elbow"], WIDE)


def test_fixed_joints_and_joints_without_play_do_not_move(urdf):
    path = urdf.write(
        *(urdf.link(name) for name in "abcde"),
        urdf.joint("weld", "fixed", "a", "b"),
        urdf.joint("stuck", "revolute", "b", "c", urdf.moves("1 0 0", 0, 0.01)),
        urdf.joint("free", "floating", "c", "d"),
        urdf.joint("hinge", "revolute", "d", "e", urdf.moves("1 0 0", 0, 1)),
    )
    robot = read_urdf(path)
    assert movable_joints(robot, drive_ranges(robot)).tolist() == [False, False, False, True]


def test_search_redraws_joint_by_joint_until_the_cost_is_low():
    rng = np.random.default_rng(0)
    start = np.full((2, 8), 7.0)
    columns = np.array([0, 2, 4, 6])
    found = search(lambda column: rng.random(2), lambda p: float(p[:, columns].max(axis=0).sum()), start, columns, rng)
    whole_draws = np.random.default_rng(0).random((6, 4, 2)).max(axis=2).sum(axis=1)
    assert found[:, columns].max(axis=0).sum() < 0.8 * whole_draws.min()
    np.testing.assert_array_equal(found[:, [1, 3, 5, 7]], 7.0)


def surface_of(*pieces):
    return Surface(np.concatenate(pieces), np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces]))


@pytest.fixture
def box(urdf):
    path = urdf.write(urdf.link("a", urdf.box("1 1 1")))
    return link_triangles(read_urdf(path), np.zeros(1, dtype=np.int64), path, (), 64.0)[0]


def placed(*offsets):
    Ts = np.tile(np.eye(4), (len(offsets), 2, 1, 1))
    Ts[:, 1, 0, 3] = offsets
    return Ts


def test_penetration_grows_as_a_small_box_sinks_into_a_large_one(box):
    score = penetration_score(surface_of(box, box / 2), placed(2.0)[0], np.random.default_rng(0))
    scores = [score(placed(offset)) for offset in (2.0, 0.75, 0.5, 0.1)]
    assert scores[:2] == [0.0, 0.0]
    assert 0.2 < scores[2] < 0.8
    assert scores[3] == 1.0


def test_penetration_of_the_rest_pose_is_forgiven_and_the_worst_state_counts(box):
    score = penetration_score(surface_of(box, box / 2), placed(0.5)[0], np.random.default_rng(0))
    assert score(placed(0.5)) == 0
    assert score(placed(0.5, 3.0, 0.1)) == score(placed(0.1)) > 0


def test_nothing_penetrates_a_flat_part(box):
    sheet = box * [1, 1, 0]
    score = penetration_score(surface_of(sheet, box / 2), placed(2.0)[0], np.random.default_rng(0))
    assert score(placed(2.0, 0.5)) == pytest.approx(score(placed(0.5)))
    assert score(placed(2.0)) == 0
