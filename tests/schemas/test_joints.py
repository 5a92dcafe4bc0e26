import numpy as np
import pytest

from schemas.joints import FREE, JOINT_KINDS, PRISMATIC, REVOLUTE, SCREW, SPHERICAL, is_tree, joint_kind, parents_first

AXIS = np.array([0.6, 0.0, 0.8])
ROWS = {  # size, angles, ball, axis, basis, units of a length of 2, symbols
    REVOLUTE: (1, 1, False, True, [[*AXIS, 0, 0, 0]], [1], ("rad",)),
    PRISMATIC: (1, 0, False, True, [[0, 0, 0, *AXIS]], [2], ("mm",)),
    SPHERICAL: (3, 3, True, False, np.eye(3, 6), [1, 1, 1], ("rad",) * 3),
    SCREW: (2, 1, False, True, [[*AXIS, 0, 0, 0], [0, 0, 0, *AXIS]], [1, 2], ("rad", "mm")),
    FREE: (6, 3, True, False, np.eye(6), [1, 1, 1, 2, 2, 2], ("rad",) * 3 + ("mm",) * 3),
}


@pytest.mark.parametrize("kind", ROWS, ids=lambda kind: kind.name)
def test_everything_about_a_kind_follows_from_its_row(kind):
    size, angles, ball, axis, basis, units, symbols = ROWS[kind]
    assert (kind.size, kind.angles, kind.is_ball, kind.has_axis) == (size, angles, ball, axis)
    np.testing.assert_array_equal(kind.basis(AXIS), basis)
    np.testing.assert_array_equal(kind.units(2.0), units)
    assert kind.symbols("mm") == symbols


def test_kinds_are_known_by_name():
    assert {name: joint_kind(name) for name in JOINT_KINDS} == JOINT_KINDS
    assert set(JOINT_KINDS) == {"revolute", "prismatic", "spherical"}
    assert len({kind.mark for kind in ROWS}) == len(ROWS)
    for name in ("screw", "free", "", "Revolute", "x" * 1000):
        with pytest.raises(ValueError, match="expected one of revolute, prismatic, spherical") as caught:
            joint_kind(name)
        assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("links", "order"),
    [
        ([], []),
        ([(0, 1), (1, 2)], [0, 1]),
        ([(1, 0), (2, 1)], [1, 0]),
        ([(3, 1), (0, 2), (2, 3)], [1, 2, 0]),
        ([(2, 0), (2, 1), (0, 3)], [0, 1, 2]),
    ],
)
def test_joints_come_after_that_of_their_parent(links, order):
    parent, child = np.array(links, dtype=np.int64).reshape(-1, 2).T
    assert parents_first(parent, child) == order
    assert parents_first(parent.tolist(), child.tolist()) == order


def test_joints_of_a_long_or_wide_tree_come_after_their_parents_too():
    rng = np.random.default_rng(0)
    for parent in (np.arange(2000), np.array([int(rng.integers(j + 1)) for j in range(2000)])):
        shuffled = rng.permutation(2000)
        parent, child = parent[shuffled], np.arange(1, 2001)[shuffled]
        seen = {0}
        for joint in parents_first(parent, child):
            assert parent[joint] in seen
            seen.add(child[joint])
        assert len(seen) == 2001


@pytest.mark.parametrize(
    ("links", "order"),
    [
        ([(0, 1), (1, 0)], []),
        ([(0, 1), (2, 3), (3, 2)], [0]),
        ([(0, 0)], []),
        ([(0, 1), (1, 2), (3, 3)], [0, 1]),
    ],
)
def test_joints_that_close_a_loop_are_left_out(links, order):
    parent, child = np.array(links).T
    assert parents_first(parent, child) == order


@pytest.mark.parametrize("links", [[(0, 1), (0, 2), (1, 2), (2, 3)], [(0, 1), (1, 2), (2, 1)]])
def test_joints_that_move_the_same_part_end_and_are_no_order(links):
    """Neither all joints once, nor without an end."""
    parent, child = np.array(links).T
    assert sorted(parents_first(parent, child)) != list(range(len(links)))


@pytest.mark.parametrize(
    ("links", "root", "expected"),
    [
        ([], 0, True),
        ([], 1, False),
        ([(0, 1), (1, 2)], 0, True),
        ([(2, 0), (0, 1)], 2, True),
        ([(2, 0), (0, 1)], 0, False),
        ([(0, 1), (1, 0)], 0, False),
        ([(1, 2), (2, 1)], 0, False),
        ([(0, 1), (0, 1)], 0, False),
        ([(0, 1), (-1, 2)], 0, False),
        ([(0, 1), (3, 2)], 0, False),
        ([(0, 1), (1, 3)], 0, False),
    ],
)
def test_a_tree_holds_every_part_once(links, root, expected):
    parent, child = np.array(links, dtype=np.int64).reshape(-1, 2).T
    assert is_tree(parent, child, root) == expected
