"""The parts of a body, the bones that move them, and the body as a skin on these bones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from jaxtyping import Float64, Int64

from stages.ingest.humans.assets import Rig, base_mesh, rig
from stages.ingest.humans.shape import Shape, shaped_vertices

Rotations = Float64[np.ndarray, "frames bones 3 3"]
Poses = Float64[np.ndarray, "frames bones 4 4"]

# part -> (its parent, the bone at whose head they meet)
PARTS: dict[str, tuple[str, str]] = {
    "pelvis": ("", "root"),
    "belly": ("pelvis", "spine04"),
    "chest": ("belly", "spine02"),
    "head": ("chest", "neck01"),
} | {
    f"{part}.{side}": (parent if parent in ("chest", "pelvis") else f"{parent}.{side}", f"{bone}.{side}")
    for side in "LR"
    for part, parent, bone in (
        ("upper_arm", "chest", "upperarm01"),
        ("forearm", "upper_arm", "lowerarm01"),
        ("hand", "forearm", "wrist"),
        ("thigh", "pelvis", "upperleg01"),
        ("calf", "thigh", "lowerleg01"),
        ("foot", "calf", "foot"),
    )
}
PART_NAMES = tuple(PARTS)
# bone -> (part, share of the part's rotation that the bone takes), so that back, neck and shoulders bend softly
BENDING: dict[str, tuple[str, float]] = {
    "spine03": ("belly", 0.4),
    "spine01": ("chest", 0.35),
    "head": ("head", 0.4),
    "clavicle.L": ("upper_arm.L", 0.12),
    "clavicle.R": ("upper_arm.R", 0.12),
}
PART_BONES = tuple(bone for _, bone in PARTS.values())
_MOVING = frozenset((*PART_BONES, *BENDING))
# parts that belong to their parents at the coarse level of detail
_DETAILS = ("belly", "chest", "hand", "foot")
_ROOT, _ROOT_HEAD = "root", "spine05"  # the rig's own root is not at a joint


@dataclass(frozen=True)
class Skeleton:
    """The bones that move, parents first, with the parent (-1 for the root) and the part of each."""

    bones: tuple[str, ...]
    parent: Int64[np.ndarray, "bones"]
    part: Int64[np.ndarray, "bones"]

    @classmethod
    def of(cls, whole: Rig) -> Self:
        """Reduce a rig to its moving bones. The nearest moving ancestor is the parent and determines the part."""
        bones = tuple(sorted(_MOVING, key=lambda bone: (len(_ancestors(bone, whole)), bone)))
        above = [next((a for a in _ancestors(bone, whole) if a in _MOVING), None) for bone in bones]
        owner = [next(a for a in (bone, *_ancestors(bone, whole)) if a in PART_BONES) for bone in bones]
        return cls(
            bones=bones,
            parent=np.array([-1 if bone is None else bones.index(bone) for bone in above], dtype=np.int64),
            part=np.array([PART_BONES.index(bone) for bone in owner], dtype=np.int64),
        )

    def bone_of(self, part: str) -> int:
        """The bone that moves a part. The part meets its parent at the bone's head."""
        return self.bones.index(PARTS[part][1])


@dataclass(frozen=True)
class Division:
    """The parts at a level of detail: the parent of each (-1 for the root), and the owner of each of `PARTS`."""

    names: tuple[str, ...]
    parent: Int64[np.ndarray, "parts"]
    owner: Int64[np.ndarray, "all_parts"]

    @classmethod
    def at(cls, detail: Literal["fine", "coarse"]) -> Self:
        """The division at a level. A part that is missing there belongs to its nearest ancestor at this level."""
        names = tuple(name for name in PARTS if detail == "fine" or name.partition(".")[0] not in _DETAILS)

        def owner(name: str) -> int:
            return names.index(name) if name in names else owner(PARTS[name][0])

        above = [PARTS[name][0] for name in names]
        return cls(
            names=names,
            parent=np.array([owner(name) if name else -1 for name in above], dtype=np.int64),
            owner=np.array([owner(name) for name in PARTS], dtype=np.int64),
        )


@dataclass(frozen=True)
class Body:
    """A skin at rest (metres, z up, facing -y, left side at +x) and the skeleton that moves it."""

    vertices: Float64[np.ndarray, "vertices 3"]
    triangles: Int64[np.ndarray, "triangles 3"]
    heads: Float64[np.ndarray, "bones 3"]
    weights: Float64[np.ndarray, "vertices bones"]
    skeleton: Skeleton

    @classmethod
    def of(cls, shape: Shape) -> Self:
        """Make the body of a shape. Raises InputError if the package with the model is damaged or not installed."""
        whole, skeleton = rig(), Skeleton.of(rig())
        everywhere = shaped_vertices(shape)
        skin, corners = np.unique(base_mesh().triangles, return_inverse=True)
        at = [whole.head[_ROOT_HEAD if bone == _ROOT else bone] for bone in skeleton.bones]
        return cls(
            vertices=everywhere[skin],
            triangles=corners.reshape(-1, 3),
            heads=np.array([everywhere[around].mean(axis=0) for around in at]),
            weights=_weights(whole, skeleton, len(everywhere))[skin],
            skeleton=skeleton,
        )

    def poses(self, rotations: Rotations) -> Poses:
        """Each bone's transform from rest. Each bone turns by `rotations` about its head, in its parent's frame."""
        T_parent_bone = np.tile(np.eye(4), (*rotations.shape[:2], 1, 1))
        T_parent_bone[..., :3, :3] = rotations
        T_parent_bone[..., :3, 3] = self.heads - np.einsum("fbij,bj->fbi", rotations, self.heads)
        Ts_world_bone = T_parent_bone.copy()
        for bone, parent in enumerate(self.skeleton.parent):
            if parent >= 0:
                Ts_world_bone[:, bone] = Ts_world_bone[:, parent] @ T_parent_bone[:, bone]
        return Ts_world_bone

    def skin(self, Ts_world_bone: Poses) -> Float64[np.ndarray, "frames vertices 3"]:
        """The posed vertices, by linear blend skinning."""
        skinned = np.empty((len(Ts_world_bone), *self.vertices.shape))
        for frame, Ts in enumerate(Ts_world_bone):
            blended = np.tensordot(self.weights, Ts[:, :3], axes=1)
            skinned[frame] = np.einsum("vij,vj->vi", blended[..., :3], self.vertices) + blended[..., 3]
        return skinned

    def part_weights(self, division: Division) -> Float64[np.ndarray, "vertices parts"]:
        """The share of each vertex's motion that is due to each part's bones."""
        weights = np.zeros((len(self.vertices), len(division.names)))
        np.add.at(weights.T, division.owner[self.skeleton.part], self.weights.T)
        return weights


def _ancestors(bone: str, whole: Rig) -> list[str]:
    """Yield a bone's ancestors up to the root."""
    above = []
    while bone := whole.parent[bone]:
        above.append(bone)
    return above


def _weights(whole: Rig, skeleton: Skeleton, vertices: int) -> Float64[np.ndarray, "vertices bones"]:
    """The rig's weights, summed over to the moving bones. They add up to one at each vertex that has any."""
    gathered = np.zeros((vertices, len(skeleton.bones)))
    for name, rows in whole.weights.items():
        mover = next(bone for bone in (name, *_ancestors(name, whole)) if bone in _MOVING)
        np.add.at(gathered[:, skeleton.bones.index(mover)], rows[:, 0].astype(np.int64), rows[:, 1])
    total = gathered.sum(axis=1, keepdims=True)
    return np.divide(gathered, total, out=np.zeros_like(gathered), where=total > 0)
