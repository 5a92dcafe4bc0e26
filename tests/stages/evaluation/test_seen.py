import numpy as np
import pytest

from stages.evaluation.seen import seen_parts, trees_of_seen

CHAIN = np.array([-1, 0, 1, 2, 0])


def labels(*counts):
    return np.repeat(np.arange(len(counts)), counts)


def test_a_part_is_seen_where_one_frame_shows_ten_points_of_it_or_a_hundredth():
    large = [labels(5000, 9, 0), labels(5000, 0, 10)]
    assert seen_parts(large, 3).tolist() == [True, False, True]
    assert seen_parts([labels(294, 2, 3), labels(297, 0, 3)], 3).tolist() == [True, False, True]
    assert seen_parts([labels(20, 1, 0)], 3).tolist() == [True, True, False]


def test_where_no_part_has_enough_points_all_count():
    assert seen_parts([labels(*[1] * 300)], 300).all()


def trees(*unseen):
    seen = np.ones(len(CHAIN), dtype=bool)
    seen[list(unseen)] = False
    return [tree.tolist() for tree in trees_of_seen(CHAIN, seen)]


@pytest.mark.parametrize(
    ("unseen", "expected"),
    [
        ((), [[-1, 0, 1, 2, 0]]),
        ((3,), [[-1, 0, 1, 0]]),
        ((2, 3), [[-1, 0, 0]]),
        ((2,), [[-1, 0, 1, 0], [-1, 0, 1, 2, 0]]),
        ((1, 2), [[-1, 0, 0], [-1, 0, 1, 2, 0]]),
        ((1, 4), [[-1, 0, 1], [-1, 0, 1, 2]]),
        ((0,), [[-1, 0, 1, 0], [-1, 0, 1, 2, 0]]),
    ],
)
def test_children_of_what_is_not_seen_hang_on_its_parent_or_on_a_link_without_points(unseen, expected):
    assert trees(*unseen) == expected
