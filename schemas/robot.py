"""A robot description: the content of a URDF or MJCF file, in metres, kilograms and radians."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float64, Int64, UInt8
from pydantic import Field

from schemas.artifact import Artifact, Schema, Unit
from schemas.model_file import Numbers, Vector

MeshRole = Literal["visual", "collision"]
SolidKind = Literal["mesh", "hull", "none"]


class RobotMesh(Schema):
    """One mesh of a link. The robot's arrays hold the vertices and triangles of all meshes in their order."""

    link: int
    role: MeshRole
    file: str = Field(description="path relative to the description")
    vertices: int
    triangles: int
    closed: bool


class RobotLink(Schema):
    """A rigid part. Its frame has the canonical frame's orientation.

    The root's frame is the canonical frame. If that lies so far away that meshes would lose digits, the root's frame
    is moved to the object.
    """

    name: str
    points: int = Field(description="number of surface points that its mesh was made from")
    origin: Vector = Field(description="of its frame, in the canonical frame's coordinates")
    mass: float = Field(gt=0)
    centre: Vector = Field(description="of mass, in the link's frame")
    inertia: tuple[float, float, float, float, float, float] = Field(
        description="ixx, iyy, izz, ixy, ixz, iyz about the centre of mass"
    )
    solid: SolidKind = Field(description="the volume that gives mass and inertia")


class RobotJoint(Schema):
    """A joint at its child's origin. At zero both links have the same orientation, so `axis` holds in either frame.

    Simulators know hinges, slides and balls. A joint of any other kind becomes several joints of one child, slides
    first. The states of a ball are rotation vectors, and its limits apply to their lengths.
    """

    name: str
    parent: int
    child: int
    type: Literal["revolute", "prismatic", "spherical"]
    axis: Vector
    lower: float
    upper: float
    effort: float
    velocity: float
    damping: float
    states: tuple[Numbers, ...] = Field(description="the fitted ones, one for each frame")


class Robot(Artifact):
    """Links in the model's order, joints from the root outwards, and all meshes in shared arrays."""

    name: str
    metres_per_unit: float
    size: float = Field(description="the diagonal of the canonical points' box, metres")
    units: str = Field(description="of the model's coordinates, if known")
    canonical_frame: int
    root: int
    free_base: bool
    density: float
    remarks: tuple[str, ...] = Field(default=(), description="remarks for the user, one line each")
    links: tuple[RobotLink, ...]
    joints: tuple[RobotJoint, ...]
    meshes: tuple[RobotMesh, ...]
    vertices: Annotated[Float64[np.ndarray, "all_vertices 3"], Unit("metre")] = Field(description="in links' frames")
    triangles: Annotated[Int64[np.ndarray, "all_triangles 3"], Unit("index")] = Field(description="per mesh, from 0")
    colours: Annotated[UInt8[np.ndarray, "visible_vertices 3"] | None, Unit("sRGB")] = Field(
        default=None, description="of the vertices of the visible meshes, in their order, if the scans have colours"
    )
    touching: Annotated[Int64[np.ndarray, "pairs 2"], Unit("index")] = Field(
        description="links whose collision meshes overlap in the canonical frame, and linked ones"
    )
    T_frame_root: Annotated[Float64[np.ndarray, "frames 4 4"], Unit("metre")]

    def geometry(self) -> list[tuple[RobotMesh, Float64[np.ndarray, "vertices 3"], Int64[np.ndarray, "triangles 3"]]]:
        """Every mesh with its vertices and triangles."""
        vertices = np.split(self.vertices, np.cumsum([mesh.vertices for mesh in self.meshes]))
        triangles = np.split(self.triangles, np.cumsum([mesh.triangles for mesh in self.meshes]))
        return list(zip(self.meshes, vertices, triangles, strict=False))

    def mesh_colours(self) -> list[UInt8[np.ndarray, "vertices 3"] | None]:
        """The colours of each mesh's vertices; None for collision meshes, and without colours."""
        if self.colours is None:
            return [None for _ in self.meshes]
        counts = [mesh.vertices if mesh.role == "visual" else 0 for mesh in self.meshes]
        split = np.split(self.colours, np.cumsum(counts)[:-1]) if counts else []
        return [of if mesh.role == "visual" else None for mesh, of in zip(self.meshes, split, strict=True)]

    def meshes_of(self, link: int, role: MeshRole) -> list[RobotMesh]:
        return [mesh for mesh in self.meshes if (mesh.link, mesh.role) == (link, role)]
