"""Sequences of a moving person with ground truth. Each frame is sampled anew from the posed skin."""

from __future__ import annotations

import zlib

import numpy as np
from jaxtyping import Float64

from schemas.config import HumansConfig
from schemas.sequence import TrueJoint
from stages.ingest.humans.catalogue import human_kind
from stages.ingest.humans.motions import move
from stages.ingest.humans.posing import pose
from stages.ingest.humans.shape import Shape
from stages.ingest.humans.skeleton import Body, Division, Poses
from stages.ingest.tracks import RawSurface, sample_frames
from stages.ingest.truth import RawTruth

Frames = list[Float64[np.ndarray, "points 3"]]


def build_human(name: str, config: HumansConfig, rng: np.random.Generator) -> tuple[Frames, RawTruth, RawSurface]:
    """Build a sequence by its name, in metres, with its true parts, joints and surface.

    The name alone determines the person and the motion. `rng` draws the points and their noise. Raises InputError if
    the package with the body model is damaged or not installed.
    """
    body, Ts_world_bone = person(name, config)
    surface = body.skin(Ts_world_bone)
    frames, tracks = sample_frames(surface, body.triangles, config.points, rng)
    if config.noise_percent:
        noise = config.noise_percent / 100 * float(np.linalg.norm(np.ptp(surface[0], axis=0)))
        frames = [points + rng.normal(0, noise, points.shape) for points in frames]
    return frames, _true_parts(body, Ts_world_bone, tracks, Division.at(config.detail)), tracks


def person(name: str, config: HumansConfig) -> tuple[Body, Poses]:
    """The body of a sequence, and the poses of its bones in every frame."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    body = Body.of(Shape.draw(rng))
    seconds = np.arange(config.frames) / config.frames_per_second
    return body, pose(body, move(human_kind(name), seconds, rng))


def _true_parts(body: Body, Ts_world_bone: Poses, tracks: RawSurface, division: Division) -> RawTruth:
    """The true parts. A point belongs to the part whose bones move it most; a part moves as the bone at its joint."""
    weights = body.part_weights(division)
    labels = [
        np.einsum("nk,nkp->np", shares, weights[corners]).argmax(axis=1)
        for shares, corners in zip(tracks.weights, tracks.corners, strict=True)
    ]
    Ts_world_part = Ts_world_bone[:, [body.skeleton.bone_of(part) for part in division.names]]
    return RawTruth(
        labels=labels,
        Ts_frame_first=Ts_world_part @ np.linalg.inv(Ts_world_part[0]),
        Ts_novel_first=np.empty((0, len(division.names), 4, 4)),
        parent=division.parent,
        part_names=division.names,
        joints=tuple(
            _true_joint(body, Ts_world_part, division, part) for part in np.flatnonzero(division.parent >= 0).tolist()
        ),
    )


def _true_joint(body: Body, Ts_world_part: Poses, division: Division, part: int) -> TrueJoint:
    """The ball joint between a part and its parent, at the head of the part's bone."""
    name, parent = division.names[part], int(division.parent[part])
    R = np.swapaxes(Ts_world_part[:, parent, :3, :3], -1, -2) @ Ts_world_part[:, part, :3, :3]
    R_since_first = R @ R[0].T
    cosine = (np.trace(R_since_first, axis1=-2, axis2=-1) - 1) / 2
    x, y, z = (
        Ts_world_part[0, part, :3, :3] @ body.heads[body.skeleton.bone_of(name)] + Ts_world_part[0, part, :3, 3]
    ).tolist()
    return TrueJoint(
        name=name,
        parent=parent,
        child=part,
        type="spherical",
        axis=(0.0, 0.0, 1.0),
        point=(x, y, z),
        states=tuple(np.arccos(np.clip(cosine, -1, 1)).tolist()),
    )
