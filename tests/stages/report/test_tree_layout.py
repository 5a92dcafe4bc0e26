import pytest

from stages.report.tree_layout import tree_layout


def test_parents_stand_above_the_middle_of_their_children():
    layout = tree_layout([(0, 1), (0, 2), (2, 3), (2, 4)], 0)
    assert layout[2][0] == pytest.approx((layout[3][0] + layout[4][0]) / 2)
    assert [layout[node][1] for node in range(5)] == [0, 1, 1, 2, 2]
    assert len(set(layout.values())) == 5


def test_a_lone_root_has_a_place():
    assert tree_layout([], 3) == {3: (1.0, 0)}
