"""The data of the page's 3D view, as JSON: points and meshes in 16 bits, joints and root motions in full precision."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, Int64, UInt8

from schemas.model_file import ModelJoint, Result
from schemas.robot import Robot
from stages.kernels.labelling.colours import distinct_colours, hexadecimal
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import normals, point_spacing, thinned
from stages.kernels.surfaces.meshing import Mesh, decimated
from stages.support.open3d_use import needing_open3d

MOST_POINTS = 20_000  # shown of the canonical cloud
MOST_FRAME_POINTS = 250_000  # shown of all frames together
MOST_POINTS_A_FRAME = 8_192
MOST_TRIANGLES = 150_000  # of all meshes together
STEPS = 32767  # from the middle of the scene to its edge


class Scale:
    """The mapping of the scene's bounding cube, with the given `centre` and `half` side, to [-1, 1]."""

    def __init__(self, clouds: Sequence[Float[np.ndarray, "_ 3"]]) -> None:
        low = np.min([cloud.min(axis=0) for cloud in clouds if len(cloud)], axis=0).astype(np.float64)
        high = np.max([cloud.max(axis=0) for cloud in clouds if len(cloud)], axis=0).astype(np.float64)
        self.centre: Float64[np.ndarray, "3"] = (low + high) / 2
        self.half = float((high - low).max()) / 2 or 1.0

    def quantised(self, p: Float[np.ndarray, "points 3"]) -> str:
        """Encode points as base64 of little-endian 16-bit integers."""
        return encoded(np.rint((p - self.centre) / self.half * STEPS).clip(-STEPS, STEPS), "<i2")


def scene_data(
    result: Result,
    frames: Sequence[Float[np.ndarray, "_ 3"]],
    robot: Robot | None = None,
    true_colours: Float64[np.ndarray, "points 3"] | None = None,
) -> dict[str, Any]:
    """The view's data. Lengths are in the input's units, points sorted by part. `true_colours` show the true parts."""
    model = result.model
    p = result.canonical_points.astype(np.float64)
    chosen = thinned(len(p), MOST_POINTS)
    chosen = chosen[np.argsort(result.labels[chosen], kind="stable")]
    most = min(MOST_POINTS_A_FRAME, MOST_FRAME_POINTS // max(len(frames), 1) + 1)
    shown = [frame[thinned(len(frame), most)] for frame in frames]
    meshes = None if robot is None else part_meshes(robot)
    painted = None if robot is None or robot.colours is None or meshes is None else mesh_colours(robot, meshes)
    distinct = len(np.unique(p[chosen], axis=0))
    scale = Scale([p, *shown, *(mesh.vertices for mesh in meshes or ())])
    colours = distinct_colours(len(model.parts))
    return {
        "centre": scale.centre.tolist(),
        "half": scale.half,
        "spacing": (point_spacing(p[chosen]) if distinct > 1 else 0.0) / scale.half,
        "diagonal": float(np.linalg.norm(np.ptp(p, axis=0))),
        "canonical": model.canonical_frame,
        "root": model.root,
        "parts": [{"id": part.id, "colour": hexadecimal(colours[part.id])} for part in model.parts],
        "joints": [_joint(result, joint, robot) for joint in model.joints],
        "T_frame_root": result.T_frame_canonical[:, model.root, :3].reshape(-1, 12).tolist(),
        "points": {
            "positions": scale.quantised(p[chosen]),
            "normals": encoded(np.rint(127 * normals(p[chosen])), "i1") if distinct > 3 else None,
            "ends": np.cumsum(np.bincount(result.labels[chosen], minlength=len(model.parts))).tolist(),
            "scanColours": None if result.colours is None else encoded(result.colours[chosen], "u1"),
            "trueColours": None if true_colours is None else encoded(np.rint(255 * true_colours[chosen]), "u1"),
        },
        "frames": [scale.quantised(frame) for frame in shown],
        "meshes": None if meshes is None else _meshes(meshes, scale, painted),
    }


@needing_open3d("meshes of parts")
def part_meshes(robot: Robot) -> list[Mesh]:
    """Each part's visible mesh in the model's coordinates, decimated if all together would make the page too large."""
    found: list[Mesh] = [Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)) for _ in robot.links]
    total = sum(mesh.triangles for mesh in robot.meshes if mesh.role == "visual")
    share = min(1.0, MOST_TRIANGLES / max(total, 1))
    for entry, vertices, triangles in robot.geometry():
        if entry.role == "visual":
            mesh = Mesh(vertices, triangles)  # decimated near its own origin, to keep precision
            mesh = mesh if share == 1 else decimated(mesh, int(share * entry.triangles))
            place = np.array(robot.links[entry.link].origin)
            found[entry.link] = Mesh((mesh.vertices + place) / robot.metres_per_unit, mesh.triangles)
    return found


def mesh_colours(robot: Robot, meshes: list[Mesh]) -> UInt8[np.ndarray, "vertices 3"]:
    """The colours of the vertices of the shown `meshes`: those of the nearest vertices of the robot's own."""
    found = [np.zeros((0, 3), dtype=np.uint8) for _ in meshes]
    for (entry, vertices, _), colours in zip(robot.geometry(), robot.mesh_colours(), strict=True):
        if colours is not None:
            place = np.array(robot.links[entry.link].origin)
            shown = meshes[entry.link].vertices * robot.metres_per_unit - place
            found[entry.link] = colours[nearest(KDTree(vertices), shown)[1]]
    return np.concatenate(found)


def joint_place(result: Result, joint: ModelJoint, robot: Robot | None) -> Float64[np.ndarray, "3"]:
    """The point of a joint's axis at which it is drawn: nearest to the child link's origin, or to its middle."""
    axis, point = np.array(joint.axis), np.array(joint.point)
    if robot is not None:
        middle = np.array(robot.links[joint.child].origin) / robot.metres_per_unit
    else:
        child = result.canonical_points[result.labels == joint.child].astype(np.float64)
        middle = child.mean(axis=0) if len(child) else point
    place: np.ndarray = point + axis * (axis @ (middle - point))
    return place


def _joint(result: Result, joint: ModelJoint, robot: Robot | None) -> dict[str, Any]:
    """A joint of any kind, as the page moves it: by each row of its basis times the number of its state."""
    kind = joint.kind
    return {
        **joint.model_dump(mode="json", include={"parent", "child", "axis", "point"}),
        "turns": kind.turns,
        "slides": kind.slides,
        "basis": kind.basis(np.array(joint.axis)).tolist(),
        "states": [np.atleast_1d(state).tolist() for state in joint.states],
        "place": joint_place(result, joint, robot).tolist(),
    }


def encoded(values: np.ndarray, dtype: str) -> str:
    """Encode an array's bytes in base64."""
    return base64.b64encode(np.ascontiguousarray(values.astype(dtype)).tobytes()).decode()


def _meshes(meshes: list[Mesh], scale: Scale, colours: UInt8[np.ndarray, "vertices 3"] | None) -> dict[str, Any]:
    """All vertices and triangles, part after part. The triangles' indices start at 0 in each part."""
    triangles: Int64[np.ndarray, "triangles 3"] = np.concatenate([mesh.triangles for mesh in meshes])
    wide = max(len(mesh.vertices) for mesh in meshes) > 0xFFFF
    return {
        "positions": scale.quantised(np.concatenate([mesh.vertices for mesh in meshes])),
        "triangles": encoded(triangles, "<u4" if wide else "<u2"),
        "scanColours": None if colours is None else encoded(colours, "u1"),
        "wide": wide,
        "vertexEnds": np.cumsum([len(mesh.vertices) for mesh in meshes]).tolist(),
        "triangleEnds": np.cumsum([len(mesh.triangles) for mesh in meshes]).tolist(),
    }
