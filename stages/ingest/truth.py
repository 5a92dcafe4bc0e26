"""Ground truth as the source gives it, in the input's units. Normalisation converts it to a `GroundTruth`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float64, Int64
from pydantic import BaseModel, Field, ValidationError

from schemas.artifact import GREATEST
from schemas.errors import InputError, first_fault
from schemas.sequence import NO_PART, TrueJoint
from stages.ingest.formats.arrays import load_npz
from stages.ingest.listing import is_file, is_folder
from stages.ingest.messages import unreadable
from stages.ingest.roboart_pickles import pickles, read_transforms

_RIGID_TOLERANCE = 1e-3  # accepts single precision, and refuses scaled or sheared transforms
_OTHER_NUMBERS = 100_000_000  # most numbers in the transforms of a file


@dataclass(frozen=True)
class RawTruth:
    """True parts, motions and tree of a sequence, in input coordinates and units.

    `labels[t]` belongs to the points of frame t as read; `NO_PART` is that of points of no part. `parent[p]` is -1 for
    the root, and -1 for every part if the tree is unknown. Axes, points and states of `joints` are in input units.
    `own_coordinates` says that each frame has coordinates of its own, so that the motion of the whole is not the
    object's.
    """

    labels: list[Int64[np.ndarray, "points"]]
    Ts_frame_first: Float64[np.ndarray, "frames parts 4 4"]
    Ts_novel_first: Float64[np.ndarray, "states parts 4 4"]
    parent: Int64[np.ndarray, "parts"]
    part_names: tuple[str, ...]
    joints: tuple[TrueJoint, ...] = ()
    own_coordinates: bool = False

    def only(self, kept: Sequence[Bool[np.ndarray, "points"]]) -> RawTruth:
        """The truth of some of the points of each frame."""
        return replace(self, labels=[labels[mask] for labels, mask in zip(self.labels, kept, strict=True)])

    def every(self, step: int) -> RawTruth:
        """The truth of every `step`-th frame, from the first on."""
        joints = tuple(joint.model_copy(update={"states": joint.states[::step]}) for joint in self.joints)
        return replace(self, labels=self.labels[::step], Ts_frame_first=self.Ts_frame_first[::step], joints=joints)


def truth_files(path: Path) -> list[Path]:
    """The files that `read_truth` reads for `path`. They are needed for a digest."""
    if is_folder(path):
        return pickles(path)
    return [file for file in (path, path.with_suffix(".json")) if is_file(file)]


def read_truth(path: Path, point_counts: Sequence[int]) -> RawTruth:
    """Read the ground truth of a sequence whose frames hold `point_counts` points as read.

    `path` is a ground_truth.npz or a folder of the original RoboArt's pickles.

    The .npz holds `labels` (frames, points), or (all points,) frame after frame; `poses` (frames, parts, 4, 4) from
    frame 0 to frame t; and optionally `novel_poses` (states, parts, 4, 4). A .json of the same name may add `root`,
    `edges_child_parent` [[child, parent], ...], `links` {part: [names]}, `own_coordinates`, and `joints`, whose entries
    are `TrueJoint` in input units.

    In a folder of pickles, state_K.pkl holds the labels, and pose_K.pkl and novel_pose_J.pkl hold the transforms from
    the first frame by part. They do not define a tree.

    Raises InputError for files that are damaged or do not fit each other.
    """
    truth = _read_pickles(path) if is_folder(path) else _read_npz(path, point_counts)
    check_truth(truth, point_counts, str(path))
    return truth


def check_truth(truth: RawTruth, point_counts: Sequence[int], where: str) -> None:
    """Raise InputError, naming `where`, unless labels, transforms, tree and joints fit each other."""
    frames, parts = len(point_counts), len(truth.parent)
    if [len(labels) for labels in truth.labels] != list(point_counts):
        raise InputError(
            f"{where}: labels: found {sum(map(len, truth.labels))} in {len(truth.labels)} frames, expected one "
            f"for each of the {sum(point_counts)} points of {frames} frames; give the labels of these very points, "
            "or take a mesh's vertices where they are its labels (ingest.mesh.take=vertices)"
        )
    for labels in truth.labels:
        if labels.size and (labels.min() < NO_PART or labels.max() >= parts):
            raise InputError(
                f"{where}: labels: found values in {labels.min()}..{labels.max()}, expected 0..{parts - 1}, "
                f"or {NO_PART} for points of no part; number the parts as in the transforms"
            )
    _check_transforms(truth.Ts_frame_first, (frames, parts), f"{where}: poses")
    states = truth.Ts_novel_first.shape[0] if truth.Ts_novel_first.ndim else 0
    _check_transforms(truth.Ts_novel_first, (states, parts), f"{where}: novel poses")
    _check_tree(truth.parent, where)
    for joint in truth.joints:
        _check_joint(joint, frames, parts, f"{where}: joint {joint.name}")


def _check_transforms(Ts: Any, leading: tuple[int, int], where: str) -> None:
    if Ts.shape != (*leading, 4, 4):
        raise InputError(f"{where}: found shape {Ts.shape}, expected {(*leading, 4, 4)}; give one for every part")
    R = Ts[..., :3, :3]
    rigid = (
        (np.abs(Ts) < GREATEST).all()  # False for NaN, too
        and (np.abs(R) < 2).all()  # so that the products below cannot overflow
        and (np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)) < _RIGID_TOLERANCE).all()
        and (np.linalg.det(R) > 0).all()
        and (np.abs(Ts[..., 3, :] - [0, 0, 0, 1]) < _RIGID_TOLERANCE).all()
    )
    if not rigid:
        raise InputError(f"{where}: found a matrix that is no rigid transform, expected [R p; 0 0 0 1]; correct it")


def _check_tree(parent: np.ndarray, where: str) -> None:
    if (parent == -1).all():
        return  # the tree is unknown
    found = f"{where}: the tree with parents {parent.tolist()}"
    if parent.min() < -1 or parent.max() >= len(parent) or (parent == -1).sum() != 1:
        raise InputError(f"{found}: expected one root and parents in 0..{len(parent) - 1}; correct the edges")
    ancestor = np.arange(len(parent))
    for _ in parent:
        ancestor = np.where(ancestor >= 0, parent[ancestor], -1)
    if (ancestor >= 0).any():
        raise InputError(f"{found}: part {int(np.argmax(ancestor >= 0))} is on or below a loop; correct the edges")


def _check_joint(joint: TrueJoint, frames: int, parts: int, where: str) -> None:
    if not (0 <= joint.parent < parts and 0 <= joint.child < parts and joint.parent != joint.child):
        raise InputError(
            f"{where}: links parts {joint.parent} and {joint.child}, expected two of 0..{parts - 1}; correct it"
        )
    if len(joint.states) != frames:
        raise InputError(f"{where}: found {len(joint.states)} states, expected one for each of {frames} frames")
    numbers = np.array([*joint.axis, *joint.point, *joint.states])
    if not (np.abs(numbers) < GREATEST).all() or abs(np.linalg.norm(joint.axis) - 1) > _RIGID_TOLERANCE:
        raise InputError(f"{where}: expected finite numbers and an axis of unit length; correct it")


_Part = Annotated[int, Field(ge=-(2**31), lt=2**31)]  # `check_truth` checks that the part exists


class _TreeFile(BaseModel):
    """ground_truth.json; keys beyond these are ignored."""

    root: _Part
    edges_child_parent: list[tuple[_Part, _Part]]
    links: dict[int, list[str]] = Field(default_factory=dict)
    joints: tuple[TrueJoint, ...] = ()
    own_coordinates: bool = False


def _read_npz(path: Path, point_counts: Sequence[int]) -> RawTruth:
    most_bytes = 8 * (2 * sum(point_counts) + _OTHER_NUMBERS)
    arrays = load_npz(path, ("labels", "poses", "novel_poses"), most_bytes)
    labels = _array(arrays, "labels", "iu", path).astype(np.int64)
    Ts = _array(arrays, "poses", "fiu", path).astype(np.float64)
    if labels.ndim not in (1, 2) or labels.size != sum(point_counts):
        raise InputError(
            f"{path}: found labels of shape {labels.shape}, expected one for each of the {sum(point_counts)} points "
            f"of {len(point_counts)} frames; give the labels of these very points, "
            "or take a mesh's vertices where they are its labels (ingest.mesh.take=vertices)"
        )
    if Ts.ndim != 4 or Ts.shape[1] == 0:
        raise InputError(f"{path}: found poses of shape {Ts.shape}, expected (frames, parts, 4, 4); correct them")
    parts = Ts.shape[1]
    Ts_novel = np.empty((0, parts, 4, 4))
    if "novel_poses" in arrays:
        Ts_novel = _array(arrays, "novel_poses", "fiu", path).astype(np.float64)
    tree = _read_tree(path.with_suffix(".json"))
    return RawTruth(
        labels=np.split(labels.reshape(-1), np.cumsum(point_counts)[:-1]),
        Ts_frame_first=Ts,
        Ts_novel_first=Ts_novel,
        parent=_parents(tree, parts, str(path.with_suffix(".json"))),
        part_names=tuple(_part_name(tree, part) for part in range(parts)),
        joints=tree.joints if tree else (),
        own_coordinates=tree.own_coordinates if tree else False,
    )


def _array(arrays: dict[str, np.ndarray], name: str, kinds: str, path: Path) -> np.ndarray:
    if name not in arrays or arrays[name].dtype.kind not in kinds:
        found = f"dtype {arrays[name].dtype} in" if name in arrays else "no"
        expected = "integers" if kinds == "iu" else "real numbers"
        raise InputError(f"{path}: found {found} array '{name}', expected {expected}; add or convert it")
    return arrays[name]


def _read_tree(path: Path) -> _TreeFile | None:
    if not is_file(path):
        return None
    try:
        return _TreeFile.model_validate_json(path.read_bytes())
    except ValidationError as error:
        raise InputError(f"{path}: {first_fault(error)}; expected root, edges_child_parent and links") from error
    except OSError as error:
        raise unreadable(path, error) from error


def _parents(tree: _TreeFile | None, parts: int, where: str) -> Int64[np.ndarray, "parts"]:
    parent = np.full(parts, -1, dtype=np.int64)
    if tree is None:
        return parent
    children = [child for child, _ in tree.edges_child_parent]
    if sorted([tree.root, *children]) != list(range(parts)):
        raise InputError(
            f"{where}: found root {tree.root} and the children {sorted(children)}, "
            f"expected each of the {parts} parts of the transforms once; correct edges_child_parent"
        )
    for child, above in tree.edges_child_parent:
        parent[child] = above  # `check_truth` checks that this is a tree
    return parent


def _part_name(tree: _TreeFile | None, part: int) -> str:
    names = tree.links.get(part, []) if tree else []
    return names[0] if names else f"part_{part}"


def _read_pickles(folder: Path) -> RawTruth:
    labels, Ts_frame_first, Ts_novel_first, ids = read_transforms(folder)
    return RawTruth(
        labels=labels,
        Ts_frame_first=Ts_frame_first,
        Ts_novel_first=Ts_novel_first,
        parent=np.full(len(ids), -1, dtype=np.int64),
        part_names=tuple(f"part_{part_id}" for part_id in ids),
    )
