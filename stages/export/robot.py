"""From a fitted model to a robot description: link frames, meshes, masses and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float64, Int64, UInt8

from schemas.config import ExportConfig
from schemas.errors import InputError
from schemas.model_file import ModelFile, ModelJoint, Result, Vector
from schemas.robot import MeshRole, Robot, RobotJoint, RobotLink, RobotMesh, SolidKind
from schemas.sequence import METRES
from stages.export.geometry import Fused, cleaned, collision_meshes, fuse, part_mesh, vertex_colours
from stages.export.inertia import Solid, about_axis, solid_of
from stages.export.remarks import remarks
from stages.final_fit.working import root_moves
from stages.kernels.points.contact import next_to_contact
from stages.kernels.points.normalisation import Normalisation
from stages.kernels.points.precision import float32_holds
from stages.kernels.points.sampling import point_spacing
from stages.kernels.surfaces.meshing import Mesh, convex_hull

HOLLOW = 0.25  # a mesh that encloses a smaller share of its hull is an open shell; the hull then gives the mass
LEAST_MASS = 1e-3  # of a link, as a share of the robot's mass, since large ratios make simulators unstable
LEAST_RADIUS = 5e-3  # RMS extent of a link, as a share of the diagonal, for the same reason
LEAST_RANGE = 0.01  # of a joint, in radians or as a share of the diagonal; simulators refuse an empty range


@dataclass(frozen=True)
class Body:
    """One part's shape in the canonical frame's coordinates. A part without points has no mesh.

    `colours` are those of the visible mesh's vertices, if known.
    """

    points: Float64[np.ndarray, "points 3"]
    visual: Mesh | None
    collision: list[Mesh]
    colours: UInt8[np.ndarray, "vertices 3"] | None = None

    def placed(self, scale: float, origin: Float64[np.ndarray, "3"]) -> Body:
        """Return the body scaled, then moved by `origin`."""
        visual, *collision = (
            Mesh(mesh.vertices * scale + origin, mesh.triangles) if mesh else None
            for mesh in (self.visual, *self.collision)
        )
        return Body(self.points * scale + origin, visual, [mesh for mesh in collision if mesh], self.colours)

    def solid(self) -> tuple[Solid, SolidKind]:
        """The solid that has the part's mass: the inside of its mesh, or of its hull if the mesh is an open shell."""
        if self.visual is None:
            return Solid(0.0, np.zeros(3), np.zeros((3, 3))), "none"
        hull = solid_of(convex_hull(self.visual.vertices))
        if self.visual.closed and (solid := solid_of(self.visual)).volume > HOLLOW * hull.volume:
            return solid, "mesh"
        return hull, "hull"


def compute_export(
    result: Result,
    frames: Sequence[Float64[np.ndarray, "_ 3"]] | None,
    config: ExportConfig,
    name: str,
    colours: Sequence[UInt8[np.ndarray, "_ 3"]] | None = None,
) -> Robot:
    """Describe a model as a robot. `frames`, in the input's coordinates, make its meshes denser if given.

    `colours` are those of the frames' points; visible meshes have colours where all points have some.

    Raises InputError for a model that cannot be described.
    """
    model = result.model
    check_exportable(result)
    scale = config.metres_per_unit or METRES.get(model.units, 1.0)
    cloud = fuse(result, frames, config.farthest, colours)
    space = Normalisation.of(result.canonical_points)
    middle, diagonal = result.canonical_points.astype(np.float64).mean(axis=0), space.scale
    cloud = replace(cloud, points=(cloud.points - middle) / diagonal)  # the same meshes in any unit
    middle, diagonal = middle * scale, diagonal * scale
    # lengths below are relative to the root's origin, since meshes hold 32-bit floats
    root_origin = np.zeros(3) if float32_holds(scale * result.canonical_points) else middle
    radius = config.reach * point_spacing(cloud.points)
    bodies = [_body(cloud, part.id, radius, config).placed(diagonal, middle - root_origin) for part in model.parts]
    order = model.joints_from_root()
    origins = np.zeros((len(bodies), 3))
    for joint in order:
        axis, point = np.array(joint.axis), np.array(joint.point) * scale - root_origin
        if joint.kind.has_axis:
            point = next_to_contact(bodies[joint.parent].points, bodies[joint.child].points, axis, point)
        origins[joint.child] = point
    links, inertias = _links(model, bodies, origins, diagonal, config.density)
    joints = _joints(model, order, links, inertias, scale, diagonal, config)
    links = tuple(link.model_copy(update={"origin": _vector(np.add(link.origin, root_origin))}) for link in links)
    T_frame_root = result.T_frame_canonical[:, model.root].copy()
    T_frame_root[:, :3, 3] *= scale
    meshes = list(_meshes(model, bodies))
    free_base = root_moves(space.motions(result.T_frame_canonical[:, model.root]))
    return Robot(
        name=name,
        metres_per_unit=scale,
        size=diagonal,
        units=model.units,
        canonical_frame=model.canonical_frame,
        root=model.root,
        free_base=free_base,
        density=config.density,
        remarks=remarks(model, config.metres_per_unit, diagonal, sum(link.mass for link in links)),
        links=links,
        joints=joints,
        meshes=tuple(entry for entry, _ in meshes),
        vertices=np.concatenate([np.zeros((0, 3))] + [mesh.vertices - origins[entry.link] for entry, mesh in meshes]),
        triangles=np.concatenate([np.zeros((0, 3), dtype=np.int64)] + [mesh.triangles for _, mesh in meshes]),
        colours=_colours(bodies),
        touching=_touching(model, bodies),
        T_frame_root=T_frame_root,
    )


def check_exportable(result: Result) -> None:
    """Raise InputError if all points coincide."""
    if np.all(result.canonical_points == result.canonical_points[0]):
        raise InputError("canonical_points: found one place only, expected points on a surface; fit the model anew")


def _body(cloud: Fused, part: int, least_radius: float, config: ExportConfig) -> Body:
    own = cloud.labels == part
    points = cleaned(cloud.points[own])
    if not len(points):
        return Body(points, None, [])
    visual = part_mesh(points, least_radius, config)
    colours = None if cloud.colours is None else vertex_colours(visual.vertices, cloud.points[own], cloud.colours[own])
    return Body(points, visual, collision_meshes(visual, config), colours)


def _colours(bodies: list[Body]) -> UInt8[np.ndarray, "vertices 3"] | None:
    """The colours of all visible meshes' vertices, if known."""
    colours = [body.colours for body in bodies if body.colours is not None]
    return np.concatenate(colours) if colours else None


def _links(
    model: ModelFile, bodies: list[Body], origins: Float64[np.ndarray, "parts 3"], diagonal: float, density: float
) -> tuple[tuple[RobotLink, ...], list[Float64[np.ndarray, "3 3"]]]:
    """The links, and their inertias as matrices."""
    solids = [body.solid() for body in bodies]
    least = LEAST_MASS * max(sum(solid.volume for solid, _ in solids), (LEAST_RADIUS * diagonal) ** 3) * density
    links, inertias = [], []
    for part, body, (solid, kind), origin in zip(model.parts, bodies, solids, origins, strict=True):
        mass = max(density * solid.volume, least)
        inertia = solid.inertia(mass, LEAST_RADIUS * diagonal)
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia.tolist()
        links.append(
            RobotLink(
                name=part.name,
                points=len(body.points),
                origin=_vector(origin),
                mass=mass,
                centre=_vector(solid.centre - origin if kind != "none" else np.zeros(3)),
                inertia=(xx, yy, zz, xy, xz, yz),
                solid=kind,
            )
        )
        inertias.append(inertia)
    return tuple(links), inertias


def _joints(
    model: ModelFile,
    order: list[ModelJoint],
    links: tuple[RobotLink, ...],
    inertias: list[Float64[np.ndarray, "3 3"]],
    scale: float,
    diagonal: float,
    config: ExportConfig,
) -> tuple[RobotJoint, ...]:
    """The joints, with limits around the observed range, and damping that settles the links that they move."""
    carried = {part.id: {part.id} for part in model.parts}
    for joint in reversed(order):
        carried[joint.parent] |= carried[joint.child]
    joints = []
    for joint in order:
        moved = [(links[part], inertias[part]) for part in sorted(carried[joint.child])]
        for piece in _pieces(joint, scale):
            sizes = np.linalg.norm(piece.states, axis=1) if piece.type == "spherical" else piece.states[:, 0]
            low, high = min(piece.lower, sizes.min()), max(piece.upper, sizes.max())
            least = LEAST_RANGE * (diagonal if piece.type == "prismatic" else 1.0)
            margin = max(config.limit_margin * (high - low), (least - (high - low)) / 2)
            joints.append(
                RobotJoint(
                    name=joint.name + piece.suffix,
                    parent=joint.parent,
                    child=joint.child,
                    type=piece.type,
                    axis=_vector(piece.axis),
                    lower=float(low - margin),
                    upper=float(high + margin),
                    effort=config.effort,
                    velocity=config.velocity,
                    damping=_load(piece, moved, links[joint.child].origin) / config.settling,
                    states=tuple(state[0] if len(state) == 1 else tuple(state) for state in piece.states.tolist()),
                )
            )
    return tuple(joints)


@dataclass(frozen=True)
class _Piece:
    """A hinge, a slide or a ball of a joint, in metres and radians. `suffix` extends the joint's name."""

    suffix: str
    type: Literal["revolute", "prismatic", "spherical"]
    axis: Float64[np.ndarray, "3"]
    lower: float
    upper: float
    states: Float64[np.ndarray, "frames size"]


def _pieces(joint: ModelJoint, scale: float) -> list[_Piece]:
    """Split a joint of any kind into slides, hinges and balls. A joint turns first, so its slides come first here."""
    kind, axis = joint.kind, np.array(joint.axis) / np.linalg.norm(joint.axis)
    basis, units = kind.basis(axis), kind.units(scale)
    states = np.array(joint.states, dtype=np.float64).reshape(len(joint.states), -1) * units
    alone = kind.size == 1 or (kind.is_ball and kind.size == 3)
    slides: list[_Piece] = []
    turns: list[_Piece] = []
    if kind.is_ball:
        turns.append(_Piece("" if alone else "_ball", "spherical", axis, 0.0, joint.uppers[0], states[:, :3]))
    for column in range(3 if kind.is_ball else 0, kind.size):
        turning = column < kind.angles
        rank = 0 if kind.is_ball else column  # a ball's joint has limits for the rotation's angle alone
        lower, upper = (limits[rank] * units[column] for limits in (joint.lowers, joint.uppers))
        direction = basis[column, :3] if turning else basis[column, 3:]
        name = "turn" if turning else "slide" if kind.slides == "axis" else "slide_" + "xyz"[column - kind.angles]
        piece = _Piece(
            "" if alone else f"_{name}",
            "revolute" if turning else "prismatic",
            direction,
            lower,
            upper,
            states[:, [column]],
        )
        (turns if turning else slides).append(piece)
    return slides + turns


def _load(piece: _Piece, moved: list[tuple[RobotLink, Float64[np.ndarray, "3 3"]]], origin: Vector) -> float:
    """The mass that a slide moves, or the inertia that a hinge turns; for a ball the mean inertia about x, y and z."""
    if piece.type == "prismatic":
        return sum(link.mass for link, _ in moved)
    axes = np.eye(3) if piece.type == "spherical" else piece.axis[None]
    loads = [
        about_axis(inertia, link.mass, np.add(link.origin, link.centre) - origin, axis)
        for link, inertia in moved
        for axis in axes
    ]
    return sum(loads) / len(axes)


def _meshes(model: ModelFile, bodies: list[Body]) -> list[tuple[RobotMesh, Mesh]]:
    meshes: list[tuple[RobotMesh, Mesh]] = []

    def add(link: int, role: MeshRole, stem: str, mesh: Mesh, suffix: str = ".stl") -> None:
        entry = RobotMesh(
            link=link,
            role=role,
            file=f"meshes/{stem}{suffix}",
            vertices=len(mesh.vertices),
            triangles=len(mesh.triangles),
            closed=mesh.closed,
        )
        meshes.append((entry, mesh))

    for part, body in zip(model.parts, bodies, strict=True):
        if body.visual is not None:
            add(part.id, "visual", f"part_{part.id}", body.visual, ".stl" if body.colours is None else ".obj")
        for rank, mesh in enumerate(body.collision):
            number = f"_{rank}" if len(body.collision) > 1 else ""
            add(part.id, "collision", f"part_{part.id}_collision{number}", mesh)
    return meshes


def _touching(model: ModelFile, bodies: list[Body]) -> Int64[np.ndarray, "pairs 2"]:
    """Pairs of links that a joint links, or whose bounding boxes overlap in the canonical frame.

    With contacts between them, a simulator would push them apart at the start.
    """
    boxes = [_box(body) for body in bodies]
    pairs = {(min(joint.parent, joint.child), max(joint.parent, joint.child)) for joint in model.joints}
    for a, box in enumerate(boxes):
        for b, other in enumerate(boxes[:a]):
            if box is not None and other is not None and np.all((box[0] <= other[1]) & (other[0] <= box[1])):
                pairs.add((b, a))
    return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)


def _box(body: Body) -> tuple[np.ndarray, np.ndarray] | None:
    if body.visual is None:
        return None
    return body.visual.vertices.min(axis=0), body.visual.vertices.max(axis=0)


def _vector(p: Float64[np.ndarray, "3"]) -> Vector:
    x, y, z = p.tolist()
    return x, y, z
