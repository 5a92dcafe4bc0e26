"""Output that URDF and MJCF share: numbers as text, indented XML, and meshes as binary STL or coloured OBJ."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float64, Int64, UInt8

from schemas.robot import Robot


def numbers(values: Iterable[float]) -> str:
    """Format numbers, separated by blanks, so that they are read back exactly."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def document(root: ET.Element, robot: Robot) -> bytes:
    """Serialise an XML document, which starts with a comment on its content."""
    unit = "an unknown unit" if robot.units == "unknown" else robot.units
    open_meshes = [mesh.file for mesh in robot.meshes if not mesh.closed]
    note = (
        f" Made by Rearticulate. Zero states: frame {robot.canonical_frame}. Metres, kilograms, radians: "
        f"1 of the model's coordinates ({unit}) = {robot.metres_per_unit:g} m, density {robot.density:g} kg/m^3. "
        f"Meshes that are not closed: {', '.join(open_meshes) or 'none'}. "
    )
    root.insert(0, ET.Comment(note))
    ET.indent(root)
    body: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return body + b"\n"


def mesh_files(robot: Robot) -> dict[str, bytes]:
    """Every mesh in its link's frame: as binary STL, or as OBJ where its vertices have colours."""
    return {
        mesh.file: stl(vertices, triangles) if colours is None else obj(vertices, triangles, colours)
        for (mesh, vertices, triangles), colours in zip(robot.geometry(), robot.mesh_colours(), strict=True)
    }


def obj(
    vertices: Float64[np.ndarray, "vertices 3"],
    triangles: Int64[np.ndarray, "triangles 3"],
    colours: UInt8[np.ndarray, "vertices 3"],
) -> bytes:
    """OBJ with red, green and blue from 0 to 1 after the coordinates of each vertex, as MeshLab and others write it."""
    rows = [
        "v {:.9g} {:.9g} {:.9g} {:.4g} {:.4g} {:.4g}\n".format(*p, *colour)
        for p, colour in zip(vertices.tolist(), (colours / 255).tolist(), strict=True)
    ]
    faces = ["f {} {} {}\n".format(*corners) for corners in (triangles + 1).tolist()]
    return "".join(rows + faces).encode()


def stl(vertices: Float64[np.ndarray, "vertices 3"], triangles: Int64[np.ndarray, "triangles 3"]) -> bytes:
    """Binary STL: 80 bytes of header, the number of triangles, then normal, corners and two spare bytes of each."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    records = np.zeros(len(triangles), dtype=record)
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    records["normal"] = normal / np.where(length > 0, length, 1.0)
    records["corners"] = corners
    return bytes(80) + np.array(len(triangles), dtype="<u4").tobytes() + records.tobytes()
