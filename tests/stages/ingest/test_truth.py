from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from schemas.errors import InputError
from stages.ingest.truth import read_truth, truth_files

COUNTS = [5, 5, 5]


def turned(*angles: float) -> np.ndarray:
    Ts = np.tile(np.eye(4), (len(angles), 1, 1))
    for T, angle in zip(Ts, angles, strict=True):
        T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        T[:3, 3] = [angle, 0, 1]
    return Ts


POSES = np.stack([np.tile(np.eye(4), (3, 1, 1)), turned(0.1, 0.2, 0.3), turned(0.4, 0.5, 0.6)])
NOVEL = np.stack([turned(0.7, 0.8, 0.9), turned(1.0, 1.1, 1.2)])
LABELS = np.arange(15).reshape(3, 5) % 3
TREE = {"root": 1, "edges_child_parent": [[0, 1], [2, 0]], "links": {"0": ["arm", "cable"], "1": ["base"], "2": []}}
JOINT = {"name": "hinge", "parent": 1, "child": 0, "type": "revolute", "axis": [0, 0, 1], "point": [1, 2, 3]}


def saved(folder: Path, tree: Any = TREE, **changes: Any) -> Path:
    arrays = {"labels": LABELS.astype(np.int16), "poses": POSES, "novel_poses": NOVEL} | changes
    np.savez(folder / "ground_truth.npz", **{name: array for name, array in arrays.items() if array is not None})
    (folder / "ground_truth.json").write_text(tree if isinstance(tree, str) else json.dumps(tree))
    return folder / "ground_truth.npz"


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_truth(path, COUNTS)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path.parent if path.suffix else path) in message
    return message


def test_arrays_and_tree_are_read(tmp_path: Path) -> None:
    states = [0.0, 0.1, 0.2]
    truth = read_truth(saved(tmp_path, TREE | {"joints": [JOINT | {"states": states}], "units": "metres"}), COUNTS)
    np.testing.assert_array_equal(truth.labels, LABELS)
    np.testing.assert_array_equal(truth.Ts_frame_first, POSES)
    np.testing.assert_array_equal(truth.Ts_novel_first, NOVEL)
    assert truth.parent.tolist() == [1, -1, 0]
    assert truth.part_names == ("arm", "base", "part_2")
    assert truth.joints[0].axis == (0, 0, 1)
    assert truth.joints[0].states == (0.0, 0.1, 0.2)


def test_frames_share_their_coordinates_unless_the_truth_says_otherwise(tmp_path: Path) -> None:
    assert not read_truth(saved(tmp_path), COUNTS).own_coordinates
    assert read_truth(saved(tmp_path, TREE | {"own_coordinates": True}), COUNTS).own_coordinates


def test_points_may_belong_to_no_part(tmp_path: Path) -> None:
    labels = LABELS - 1
    np.testing.assert_array_equal(read_truth(saved(tmp_path, labels=labels), COUNTS).labels, labels)


def test_tree_and_novel_poses_may_be_missing(tmp_path: Path) -> None:
    path = saved(tmp_path, novel_poses=None)
    path.with_suffix(".json").unlink()
    truth = read_truth(path, COUNTS)
    assert truth.Ts_novel_first.shape == (0, 3, 4, 4)
    assert truth.parent.tolist() == [-1, -1, -1]
    assert truth.part_names == ("part_0", "part_1", "part_2")
    assert truth.joints == ()


def test_labels_of_frames_with_differing_counts_follow_each_other(tmp_path: Path) -> None:
    labels = np.array([0, 1, 2, 0, 1, 1, 2])
    truth = read_truth(saved(tmp_path, labels=labels), [3, 2, 2])
    assert [of_frame.tolist() for of_frame in truth.labels] == [[0, 1, 2], [0, 1], [1, 2]]


def scaled(Ts: np.ndarray, factor: float) -> np.ndarray:
    return Ts * np.array([factor, factor, factor, 1])


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"labels": None}, "no array 'labels'"),
        ({"poses": None}, "no array 'poses'"),
        ({"labels": LABELS.astype(float)}, "float64"),
        ({"labels": LABELS[:, :4]}, "(3, 4)"),
        ({"labels": LABELS + 1}, "1..3"),
        ({"labels": LABELS - 2}, "-2..0"),
        ({"poses": POSES[:2]}, "(2, 3, 4, 4)"),
        ({"poses": POSES[0]}, "(3, 4, 4)"),
        ({"poses": POSES[:, :0]}, "(3, 0, 4, 4)"),
        ({"poses": POSES[..., :3, :]}, "(3, 3, 3, 4)"),
        ({"poses": POSES.astype(complex)}, "complex128"),
        ({"poses": POSES * np.nan}, "no rigid transform"),
        ({"poses": scaled(POSES, 2)}, "no rigid transform"),
        ({"poses": scaled(POSES, 1e200)}, "no rigid transform"),
        ({"poses": POSES * np.array([-1, 1, 1, 1])}, "no rigid transform"),
        ({"poses": np.swapaxes(POSES, -1, -2)}, "no rigid transform"),
        ({"novel_poses": NOVEL[:, :2]}, "(2, 2, 4, 4)"),
        ({"novel_poses": np.array(1.0)}, "()"),
        ({"labels": np.full((3, 5), None)}, "never unpickled"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tmp_path: Path, changes: dict[str, Any], found: str) -> None:
    assert found in refusal(saved(tmp_path, **changes))


@pytest.mark.parametrize(
    ("tree", "found"),
    [
        ("not json", "Invalid JSON"),
        ("[" * 100_000, "Invalid JSON"),
        ({"root": 0}, "edges_child_parent"),
        (TREE | {"root": "base"}, "root"),
        (TREE | {"root": 7}, "root 7"),
        (TREE | {"edges_child_parent": [[0, 1]]}, "children [0]"),
        (TREE | {"edges_child_parent": [[0, 1], [0, 1]]}, "children [0, 0]"),
        (TREE | {"edges_child_parent": [[0, 1], [2, 9]]}, "[1, -1, 9]"),
        (TREE | {"edges_child_parent": [[0, 1], [2, 10**30]]}, "edges_child_parent.1.1"),
        (TREE | {"edges_child_parent": [[0, 1], [2, -1]]}, "[1, -1, -1]"),
        (TREE | {"edges_child_parent": [[0, 2], [2, 0]]}, "loop"),
        (TREE | {"joints": [JOINT]}, "states"),
        (TREE | {"joints": [JOINT | {"states": [0, 1]}]}, "2 states"),
        (TREE | {"joints": [JOINT | {"states": [0, 1, 2], "child": 3}]}, "parts 1 and 3"),
        (TREE | {"joints": [JOINT | {"states": [0, 1, 2], "axis": [0, 0, 2]}]}, "unit length"),
        (TREE | {"joints": [JOINT | {"states": [0, 1, float("nan")]}]}, "finite"),
    ],
)
def test_trees_that_are_none_are_refused(tmp_path: Path, tree: Any, found: str) -> None:
    assert found in refusal(saved(tmp_path, tree))


def write_pickles(folder: Path, **changes: Any) -> Path:
    """Parts 4, 0 and 9 in place of 0, 1 and 2, so that ids must be mapped."""
    ids = np.array([4, 0, 9])
    files = {f"state_{k}": {"pc": np.ones((5, 3)), "part_id": ids[LABELS[k]]} for k in range(3)}
    files |= {f"pose_{k}": dict(zip(ids, POSES[k], strict=True)) for k in (1, 2)}
    files |= {f"novel_pose_{j}": dict(zip(ids.tolist(), NOVEL[j], strict=True)) for j in range(2)}
    for name, content in (files | changes).items():
        if content is not None:
            (folder / f"{name}.pkl").write_bytes(pickle.dumps(content))
    (folder / "graph.gpickle").write_bytes(b"cos\nsystem\n(Vfalse\ntR.")
    return folder


def test_the_original_roboarts_pickles_tell_labels_and_transforms_but_no_tree(tmp_path: Path) -> None:
    truth = read_truth(write_pickles(tmp_path), COUNTS)
    order = [1, 0, 2]  # ids 0, 4, 9 in the order of the parts above
    np.testing.assert_array_equal(np.array(order)[np.array(truth.labels)], LABELS)
    np.testing.assert_array_equal(truth.Ts_frame_first, POSES[:, order])
    np.testing.assert_array_equal(truth.Ts_novel_first, NOVEL[:, order])
    assert truth.parent.tolist() == [-1, -1, -1]
    assert truth.part_names == ("part_0", "part_4", "part_9")


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"pose_1": None}, "pose_1.pkl"),
        ({"pose_1": {4: POSES[1, 0], 0: POSES[1, 1]}}, "part 9"),
        ({"pose_1": [POSES[1, 0]]}, "list"),
        ({"pose_1": {4: POSES[1, 0], 0: POSES[1, 1], 9: np.eye(3)}}, "part 9"),
        ({"pose_1": {4: POSES[1, 0], 0: POSES[1, 1], 9: np.ones((4, 4))}}, "no rigid transform"),
        ({"state_2": {"pc": np.ones((5, 3))}}, "part_id"),
        ({"state_2": {"pc": np.ones((5, 3)), "part_id": np.zeros((5, 2), int)}}, "(5, 2)"),
        ({"state_2": {"pc": np.ones((5, 3)), "part_id": np.zeros(5)}}, "float64"),
        ({"state_2": {"pc": np.ones((5, 3)), "part_id": np.zeros(4, int)}}, "labels: found 14"),
        ({"novel_pose_0": {}}, "part 0"),
    ],
)
def test_pickles_that_do_not_fit_are_refused(tmp_path: Path, changes: dict[str, Any], found: str) -> None:
    assert found in refusal(write_pickles(tmp_path, **changes))


def test_the_files_of_a_truth_are_those_that_are_read(tmp_path: Path) -> None:
    path = saved(tmp_path)
    write_pickles(tmp_path)
    assert [file.name for file in truth_files(path)] == ["ground_truth.npz", "ground_truth.json"]
    names = {file.name for file in truth_files(tmp_path)}
    assert names == {*(f"state_{k}.pkl" for k in range(3)), "pose_1.pkl", "pose_2.pkl"} | {
        f"novel_pose_{j}.pkl" for j in range(2)
    }
