from __future__ import annotations

from collections import Counter

import pytest

from schemas.errors import InputError
from stages.ingest.roboart import robot_kind, robot_names, robot_split


def test_types_are_as_in_table_3():
    assert len(robot_names()) == 18
    assert robot_names() == sorted(robot_names())
    assert Counter(map(robot_kind, robot_names())) == {
        "arm": 5,
        "biped": 2,
        "hand": 2,
        "mobile manipulator": 1,
        "humanoid": 4,
        "quadruped": 4,
    }


def test_the_split_is_as_in_table_4_with_nao_for_the_second_panda():
    split = {name: [robot for robot in robot_names() if robot_split(robot) == name] for name in ("train", "validation")}
    assert split == {"train": ["atlas", "baxter", "iiwa", "laikago"], "validation": ["cassie", "nao", "panda", "spot"]}
    assert sum(robot_split(robot) == "test" for robot in robot_names()) == 10


def test_an_unknown_robot_is_refused_with_the_names_that_are_known():
    with pytest.raises(InputError, match=r"'r2d2'.*a1, allegro, atlas"):
        robot_kind("r2d2")
