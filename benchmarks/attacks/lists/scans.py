"""Meshes, depth images and laser scans that are not what they say, or name what is not theirs."""

from __future__ import annotations

import base64
import io
import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from attacks.case import Case, Maker, Verdict, similar
from attacks.hinge import Prepared, hinge
from attacks.lists.makers import FIT, a_folder, a_pipe, both, each_frame, file, found, link, sparse

REFUSED: tuple[Verdict, ...] = ("refused",)
READ: tuple[Verdict, ...] = ("accepted",)
OTHER = "another file|not followed"
BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype="<f4")
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4]],
    dtype="<u2",
)
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in BOX) + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES)


def document() -> dict[str, Any]:
    """A box as glTF, whose buffer is the binary chunk."""
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 30, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 96},
            {"buffer": 0, "byteLength": 60, "byteOffset": 96},
        ],
        "buffers": [{"byteLength": 156}],
    }


def glb(change: Callable[[dict[str, Any]], object] = lambda d: None, length: int | None = None) -> bytes:
    content = document()
    change(content)
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    binary = BOX.tobytes() + FACES.tobytes()
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body) if length is None else length) + body


def meshes(suffix: str, content: bytes | str) -> Maker:
    """Two frames of this content."""
    return both(*(file(f"frames/{t}{suffix}", content) for t in range(2)))


def gltf(name: str, change: Callable[[dict[str, Any]], object], says: str = "") -> Case:
    return Case(f"glb {name}", FIT, meshes(".glb", glb(change)), may=REFUSED, says=says)


def referring(uri: str) -> bytes:
    content = document()
    content["buffers"][0]["uri"] = uri
    return json.dumps(content).encode()


def png(rows: int, columns: int, data: bytes) -> bytes:
    """16 bits of grey; `data` is what is compressed."""
    head = struct.pack(">IIBBBBB", columns, rows, 16, 0, 0, 0, 0)
    content = b"\x89PNG\r\n\x1a\n"
    for kind, piece in ((b"IHDR", head), (b"IDAT", zlib.compress(data)), (b"IEND", b"")):
        content += struct.pack(">I", len(piece)) + kind + piece + struct.pack(">I", zlib.crc32(kind + piece))
    return content


def picture(rows: int = 60, columns: int = 80) -> bytes:
    depth = (1000 + 200 * np.sin(np.arange(rows * columns) / 300)).astype(">u2").reshape(rows, columns)
    return png(rows, columns, b"".join(b"\0" + row.tobytes() for row in depth))


def depth(*makers: Maker) -> Maker:
    """A folder of depth images, with changes."""
    images = [file(f"frames/depth/{t}.png", picture()) for t in range(2)]
    return both(*images, file("frames/intrinsics.txt", "70 70 40 30"), *makers)


def laser(name: str, change: Callable[[bytearray], object], suffix: str = ".las") -> Case:
    """Frames by laspy or pye57, changed."""

    def make(folder: Path, prepared: Prepared) -> None:
        (folder / "frames").mkdir()
        for t, points in enumerate(hinge(frames=2, points=400)):
            path = folder / "frames" / f"{t}{suffix}"
            _write_las(path, points) if suffix != ".e57" else _write_e57(path, points)
            content = bytearray(path.read_bytes())
            change(content)
            path.write_bytes(content)

    return Case(f"{suffix[1:]} {name}", FIT, make, may=REFUSED)


def _write_las(path: Path, points: np.ndarray) -> None:
    import laspy

    header = laspy.LasHeader(point_format=2, version="1.2")
    header.scales = [1e-4] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    data.write(path)


def _write_e57(path: Path, points: np.ndarray) -> None:
    import pye57

    with pye57.E57(str(path), mode="w") as written:
        written.write_scan_raw({f"cartesian{axis}": points[:, index] for index, axis in enumerate("XYZ")})


def put(form: str, at: int, value: int) -> Callable[[bytearray], object]:
    return lambda content: struct.pack_into(form, content, at, value)


def cut(count: int) -> Callable[[bytearray], object]:
    def change(content: bytearray) -> None:
        del content[count:]

    return change


def ply_with_faces(path: Path, p: np.ndarray) -> None:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(p)}\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 999999999999\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_text(head + "".join(f"{x} {y} {z}\n" for x, y, z in p) + "3 0 1 2\n")


def bomb() -> str:
    """A picture of 400 million pixels in some kilobytes, as a data URI."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.new("1", (20000, 20000)).save(buffer, "PNG")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def textured(content: dict[str, Any], uri: str) -> None:
    content["images"] = [{"uri": uri}]
    content["textures"] = [{"source": 0}]
    content["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    content["meshes"][0]["primitives"][0]["material"] = 0
    content["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = 2
    content["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC2"})


CASES = similar(
    Case(
        "obj with materials of others",
        FIT,
        meshes(".obj", "mtllib /dev/zero\n" + OBJ),
        may=READ,
        check=found(2, None, None),
    ),
    Case(
        "obj with a pipe of materials",
        FIT,
        both(meshes(".obj", "mtllib m.mtl\n" + OBJ), a_pipe("frames/m.mtl")),
        may=READ,
    ),
    Case("obj of no faces that are there", FIT, meshes(".obj", OBJ.replace("f 1 ", "f 99 ")), may=REFUSED),
    Case("obj of 3 GiB", FIT, both(sparse("frames/0.obj"), sparse("frames/1.obj")), may=REFUSED, says="max_mib"),
    Case("stl of 3 GiB", FIT, both(sparse("frames/0.stl", bytes(84)), sparse("frames/1.stl")), may=REFUSED),
    Case("stl of 4 billion triangles", FIT, meshes(".stl", bytes(80) + b"\xff" * 4 + bytes(500)), may=REFUSED),
    Case("stl that is a folder", FIT, both(a_folder("frames/0.stl"), a_folder("frames/1.stl")), may=REFUSED),
    Case("ply of 999999999999 faces", FIT, each_frame(ply_with_faces, ".ply"), may=REFUSED),
    *(
        Case(f"gltf that refers to {uri[:30]}", FIT, meshes(".gltf", referring(uri)), may=REFUSED, says=OTHER)
        for uri in ("box.bin", "../box.bin", "/etc/passwd", "file:///etc/passwd", "http://localhost:1/box.bin")
    ),
    Case(
        "gltf that refers to a pipe",
        FIT,
        both(meshes(".gltf", referring("box.bin")), a_pipe("frames/box.bin")),
        may=REFUSED,
        says=OTHER,
    ),
    gltf("of 1e12 vertices", lambda d: d["accessors"][0].update(count=10**12)),
    gltf("of 1e30 vertices", lambda d: d["accessors"][0].update(count=10**30)),
    gltf("of -8 vertices", lambda d: d["accessors"][0].update(count=-8)),
    gltf("of zeros without bytes", lambda d: d["accessors"][0].update(count=2 * 10**9, bufferView=None)),
    gltf("of a view beyond the buffer", lambda d: d["bufferViews"][0].update(byteLength=10**9)),
    gltf("of a node below itself", lambda d: d["nodes"][0].update(children=[0])),
    gltf("of a node that is not there", lambda d: d["nodes"][0].update(children=[7])),
    gltf("of a mesh a million times", lambda d: d["nodes"].extend([{"mesh": 0}] * 1_000_000), "20,000,000"),
    gltf("of a mesh repeated by all", lambda d: d["meshes"].extend([d["meshes"][0]] * 10) or d["nodes"].clear()),
    gltf("with a picture of others", lambda d: textured(d, "/etc/passwd"), OTHER),
    gltf("with a picture of 400 million pixels", lambda d: textured(d, bomb())),
    gltf("packed by Draco", lambda d: d.update(extensionsRequired=["KHR_draco_mesh_compression"]), "compression"),
    Case("glb that is too short", FIT, meshes(".glb", glb(length=10**6)), may=REFUSED),
    Case("glb of deep JSON", FIT, meshes(".gltf", '{"nodes":' + "[" * 200_000), may=REFUSED),
    Case("depth images", FIT, depth(), may=READ, check=found(2, None, None)),
    Case(
        "depth of 65535 x 65535 pixels", FIT, depth(file("frames/depth/0.png", png(65535, 65535, b"\0"))), may=REFUSED
    ),
    Case("depth that ends early", FIT, depth(file("frames/depth/0.png", png(60, 80, bytes(100)))), may=REFUSED),
    Case("depth that is PostScript", FIT, depth(file("frames/depth/0.png", "%!PS-Adobe-3.0 EPSF-3.0\n")), may=REFUSED),
    Case("depth that is a pipe", FIT, depth(a_pipe("frames/depth/0.png")), may=("refused", "accepted", "failed")),
    Case("intrinsics that are a pipe", FIT, depth(a_pipe("frames/intrinsics.txt")), may=REFUSED),
    Case("intrinsics of 3 GiB", FIT, depth(sparse("frames/intrinsics.txt")), may=REFUSED),
    Case(
        "intrinsics that link to /dev/zero",
        FIT,
        depth(link("frames/poses.txt", "/dev/zero")),
        may=("accepted", "refused"),
    ),
    Case("poses that are NaN", FIT, depth(file("frames/poses.txt", "nan " * 16 + "\n" + "nan " * 16)), may=REFUSED),
    Case("poses of 3 GiB", FIT, depth(sparse("frames/poses.npy", b"\x93NUMPY\x01\x00")), may=REFUSED),
    laser("of 4 billion points", put("<I", 107, 2**32 - 1)),
    laser("of 4 billion records", put("<I", 100, 2**32 - 1)),
    laser("whose points begin beyond its end", put("<I", 96, 2**32 - 1)),
    laser("that ends early", cut(1000)),
    laser("of 4 billion points", put("<I", 107, 2**32 - 1), ".laz"),
    laser("that ends early", cut(1000), ".laz"),
    laser("of another length", put("<Q", 16, 2**40), ".e57"),
    laser("whose XML is elsewhere", put("<Q", 24, 2**40), ".e57"),
    laser("of pages of no size", put("<Q", 40, 0), ".e57"),
    laser("that ends early", cut(2048), ".e57"),
)
