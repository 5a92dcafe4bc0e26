"""The pose of each bone from the angles of a motion: neutral pose, rotations, and feet that stay on the ground."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from stages.ingest.humans.motions import Motion
from stages.ingest.humans.skeleton import BENDING, PARTS, Body, Poses, Rotations

_ARM_ABDUCTION = 10.0  # degrees between a hanging upper arm and the vertical
_ELBOW_STRETCH = 25.0  # degrees by which the mesh's bent elbow is stretched
_STANDING = 0.03  # metres; if the feet's heights differ by more, the person stands on the lower one
_BACKWARD = ("upper_arm", "forearm", "hand", "thigh", "foot")  # a rotation about +x moves these backward
_LIMBS = (*_BACKWARD, "calf")


def pose(body: Body, motion: Motion) -> Poses:
    """Each bone's transform from rest in every frame, on a floor at z = 0."""
    Ts_world_bone = body.poses(bone_rotations(body, motion))
    Ts_world_bone[..., :3, 3] += _on_floor(body, Ts_world_bone, motion)[:, None]
    return Ts_world_bone


def bone_rotations(body: Body, motion: Motion) -> Rotations:
    """Each bone's rotation in its parent's frame, relative to the mesh at rest: neutral pose, then motion."""
    bones, neutral = body.skeleton.bones, _neutral(body)
    turned = _shared_rotations(motion)
    still = np.eye(3)
    rotations = np.empty((len(motion.lift), len(bones), 3, 3))
    for index, bone in enumerate(bones):
        parent = body.skeleton.parent[index]
        N_parent = neutral.get(bones[parent], still) if parent >= 0 else still
        rotations[:, index] = N_parent.T @ turned[bone] @ neutral.get(bone, still)
    return rotations


def _shared_rotations(motion: Motion) -> dict[str, Float64[np.ndarray, "frames 3 3"]]:
    """Each bone's rotation relative to its parent: that of its part, or a share of one."""
    rotvecs = {part: _rotation(part, angles).as_rotvec() for part, angles in motion.angles.items()}
    taken = dict.fromkeys(rotvecs, 0.0)
    shared = {}
    for bone, (part, share) in BENDING.items():
        shared[bone] = Rotation.from_rotvec(share * rotvecs[part]).as_matrix()
        taken[part] += share
    return shared | {
        bone: Rotation.from_rotvec((1 - taken[part]) * rotvecs[part]).as_matrix() for part, (_, bone) in PARTS.items()
    }


def _rotation(part: str, angles: Float64[np.ndarray, "frames 3"]) -> Rotation:
    """Compose flexion, abduction and turn, as rotations about x (left), y (backward) and z (up), in this order."""
    kind, _, side = part.partition(".")
    outward = {"L": -1.0, "R": 1.0}.get(side, 1.0)
    signs = (-1.0 if kind in _BACKWARD else 1.0, outward, outward if kind in _LIMBS else -1.0)
    return Rotation.from_euler("xyz", angles * signs, degrees=True)


def _neutral(body: Body) -> dict[str, Float64[np.ndarray, "3 3"]]:
    """The rotations of the arms' bones, in the body's axes, from the mesh at rest to hanging arms."""
    neutral = {}
    for side, left in (("L", 1.0), ("R", -1.0)):
        shoulder, elbow = (body.heads[body.skeleton.bone_of(f"{part}.{side}")] for part in ("upper_arm", "forearm"))
        x, _, z = elbow - shoulder
        raised = np.degrees(np.arctan2(left * x, -z)) - _ARM_ABDUCTION
        down = Rotation.from_euler("y", left * raised, degrees=True)
        stretched = Rotation.from_euler("x", _ELBOW_STRETCH, degrees=True) * down
        neutral[f"upperarm01.{side}"] = down.as_matrix()
        neutral[f"lowerarm01.{side}"] = neutral[f"wrist.{side}"] = stretched.as_matrix()
    return neutral


def _on_floor(body: Body, Ts_world_bone: Poses, motion: Motion) -> Float64[np.ndarray, "frames 3"]:
    """The translation of the body that puts its lowest point at height `motion.lift` and keeps the standing foot."""
    feet = [body.skeleton.bone_of(f"foot.{side}") for side in "LR"]
    Ts_world_foot = Ts_world_bone[:, feet]
    p = np.einsum("fbij,bj->fbi", Ts_world_foot[..., :3, :3], body.heads[feet]) + Ts_world_foot[..., :3, 3]
    height = p[..., 2] - p[..., 2].min(axis=1, keepdims=True)
    standing = np.exp(-height / _STANDING)
    standing = (standing[1:] + standing[:-1]) / 2
    steps = np.diff(p, axis=0) * (standing / standing.sum(axis=1, keepdims=True))[..., None]
    moved = np.zeros((len(p), 3))
    moved[1:] = -np.cumsum(steps.sum(axis=1), axis=0)
    moved[:, 2] = motion.lift - body.skin(Ts_world_bone)[..., 2].min(axis=1)
    return moved
