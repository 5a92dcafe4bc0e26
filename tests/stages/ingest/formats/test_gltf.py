"""glTF as Blender, trimesh and phones' scan apps write it; and files that name others or declare what they lack."""

from __future__ import annotations

import base64
import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from schemas.errors import InputError
from stages.ingest.formats.gltf import MOST_PIXELS, read_gltf
from stages.ingest.formats.mesh_pieces import MeshSampling
from stages.ingest.point_formats import read_cloud

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype="<u2")
COLOURS = np.array([[65535, 0, 0, 65535], [0, 65535, 0, 65535], [0, 0, 65535, 65535], [0, 0, 0, 65535]], dtype="<u2")


def glb(document: dict[str, Any], binary: bytes = b"") -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def blender() -> tuple[dict[str, Any], bytes]:
    """A tetrahedron in a turned, moved and scaled node below another, its colours as 16 bits, as Blender has them."""
    views = [CORNERS.tobytes(), COLOURS.tobytes(), FACES.tobytes()]
    starts = np.cumsum([0, *map(len, views)]).tolist()
    half = float(np.sqrt(0.5))
    document = {
        "asset": {"generator": "Khronos glTF Blender I/O v4.2", "version": "2.0"},
        "scene": 0,
        "scenes": [{"name": "Scene", "nodes": [1]}],
        "nodes": [
            {"mesh": 0, "name": "Body", "rotation": [0, 0, half, half], "scale": [2, 2, 2]},
            {"children": [0], "name": "Empty", "translation": [10, 0, 0]},
        ],
        "meshes": [{"primitives": [{"attributes": {"COLOR_0": 1, "POSITION": 0}, "indices": 2}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "max": [1, 1, 1], "min": [0, 0, 0], "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 4, "normalized": True, "type": "VEC4"},
            {"bufferView": 2, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(view), "byteOffset": start}
            for view, start in zip(views, starts, strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    return document, b"".join(views)


def textured() -> bytes:
    """A square of two triangles with a picture of four colours, as scan apps export it, by trimesh."""
    picture = Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], dtype=np.uint8))
    mesh = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture.resize((64, 64), Image.Resampling.NEAREST))
    mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.vertices[:, :2], material=material)
    scene = trimesh.Scene()
    scene.add_geometry(mesh, transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    return scene.export(file_type="glb")


def refusal(content: bytes) -> str:
    with pytest.raises(ValueError, match=r".") as caught:
        read_gltf(content)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_blenders_nodes_and_colours_of_16_bits_are_read() -> None:
    (piece,) = read_gltf(glb(*blender()))
    np.testing.assert_allclose(piece.vertices, [[10, 0, 0], [10, 2, 0], [8, 0, 0], [10, 0, 2]], atol=1e-6)
    np.testing.assert_array_equal(piece.triangles, FACES)
    np.testing.assert_array_equal(piece.colours, [[255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 0, 0]])


def test_a_gltf_with_everything_in_it_is_read_as_the_glb_is() -> None:
    document, binary = blender()
    document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    (there,), (here,) = read_gltf(glb(*blender())), read_gltf(json.dumps(document).encode())
    np.testing.assert_array_equal(here.vertices, there.vertices)
    np.testing.assert_array_equal(here.colours, there.colours)


def test_a_scene_is_where_trimesh_places_it() -> None:
    rng = np.random.default_rng(0)
    scene = trimesh.Scene()
    parent = scene.graph.base_frame
    for index in range(4):
        T = trimesh.transformations.random_rotation_matrix(rng.random(3))
        T[:3, 3] = rng.normal(size=3)
        box = trimesh.creation.box(rng.uniform(1, 2, 3))
        scene.add_geometry(box, node_name=f"node{index}", parent_node_name=parent, transform=T)
        parent = f"node{index}"
    pieces = read_gltf(scene.export(file_type="glb"))
    found = np.concatenate([piece.vertices for piece in pieces])
    expected = scene.to_mesh().vertices
    assert len(found) == len(expected)
    assert np.linalg.norm(found[:, None] - expected[None], axis=-1).min(axis=0).max() < 1e-5


def test_sampled_points_have_the_colours_of_the_picture(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    path.write_bytes(textured())
    cloud = read_cloud(path, sampling=MeshSampling(4000, np.random.default_rng(0)))
    assert cloud.colours is not None
    u, v = cloud.points[:, 0] - 5, cloud.points[:, 1]
    clear = (np.abs(u - 0.5) > 0.02) & (np.abs(v - 0.5) > 0.02)
    expected = np.array([[[0, 0, 255], [255, 255, 255]], [[255, 0, 0], [0, 255, 0]]])  # from below, as v goes up
    np.testing.assert_array_equal(cloud.colours[clear], expected[(v > 0.5).astype(int), (u > 0.5).astype(int)][clear])


def test_interleaved_sparse_and_normalised_numbers_are_read() -> None:
    """As gltfpack writes them; trimesh takes them for others."""
    rows = np.zeros(4, dtype=[("p", "<i2", 3), ("pad", "<i2"), ("colour", "u1", 4)])
    rows["p"], rows["colour"] = (CORNERS * 32767).astype("<i2"), 100
    sparse = np.array([3], dtype="<u2").tobytes() + bytes(2) + np.array([[0, 0, 16384]], dtype="<i2").tobytes()
    document, _ = blender()
    document["bufferViews"] = [
        {"buffer": 0, "byteLength": 48, "byteOffset": 0, "byteStride": 12},
        {"buffer": 0, "byteLength": len(sparse), "byteOffset": 48},
    ]
    place = {"count": 1, "indices": {"bufferView": 1, "componentType": 5123}}
    place["values"] = {"bufferView": 1, "byteOffset": 4}
    document["accessors"] = [
        {"bufferView": 0, "componentType": 5122, "count": 4, "normalized": True, "type": "VEC3", "sparse": place},
        {"bufferView": 0, "byteOffset": 8, "componentType": 5121, "count": 4, "normalized": True, "type": "VEC4"},
    ]
    document["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "mode": 5}]}]
    document["nodes"] = [{"mesh": 0}]
    document["scenes"] = [{"nodes": [0]}]
    document["buffers"] = [{"byteLength": 48 + len(sparse)}]
    (piece,) = read_gltf(glb(document, rows.tobytes() + sparse))
    np.testing.assert_allclose(piece.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.5]], atol=1e-4)
    np.testing.assert_array_equal(piece.triangles, [[0, 1, 2], [1, 2, 3]])
    assert (piece.colours == 100).all()


def test_references_to_other_files_are_refused(tmp_path: Path) -> None:
    secret = tmp_path / "other.bin"
    secret.write_bytes(blender()[1])
    document, _ = blender()
    for uri in ("other.bin", "../other.bin", secret.as_uri(), str(secret), "https://example.org/a.bin", "data:,abc"):
        document["buffers"][0]["uri"] = uri
        path = tmp_path / "a.gltf"
        path.write_text(json.dumps(document))
        with pytest.raises(InputError, match=r"a\.gltf: found a reference to another file .* export it as \.glb"):
            read_cloud(path)


def picture_of(uri: str) -> bytes:
    """A textured file whose picture is a URI."""
    content = textured()
    length = struct.unpack("<I", content[12:16])[0]
    document = json.loads(content[20 : 20 + length])
    document["images"] = [{"uri": uri}]
    return glb(document, content[28 + length :])


def test_pictures_in_other_files_huge_ones_and_other_formats_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "another file ('texture.png')" in refusal(picture_of("texture.png"))
    bomb = io.BytesIO()
    Image.new("1", (16384, 16384)).save(bomb, "PNG")  # 270 million pixels in some kilobytes
    assert len(bomb.getvalue()) < 100_000 < MOST_PIXELS
    message = refusal(picture_of("data:image/png;base64," + base64.b64encode(bomb.getvalue()).decode()))
    assert "pixels" in message or "DecompressionBomb" in message
    postscript = base64.b64encode(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n").decode()
    assert "none of PNG, JPEG, WEBP" in refusal(picture_of(f"data:image/png;base64,{postscript}"))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (lambda d: d["accessors"][0].update(count=10**12), "more than 20,000,000"),
        (lambda d: d["accessors"][0].update(count=5), "too few for 5 rows"),
        (lambda d: d["accessors"][0].update(bufferView=7), "not there"),
        (lambda d: d["accessors"][0].update(count=-1), "count"),
        (lambda d: d["accessors"][0].update(type="VEC2"), "4 x 2 numbers, expected 4 x 3"),
        (lambda d: d["accessors"][1].update(count=3), "3 x 4 numbers, expected 4 x 3"),
        (lambda d: d["bufferViews"][0].update(byteLength=10**9), "a view up to byte"),
        (lambda d: d["buffers"][0].update(byteLength=10**9), "of the 1000000000 bytes"),
        (lambda d: d["buffers"].append({"byteLength": 4, "uri": "data:;base64,!!!!"}), "base64"),
        (lambda d: d["nodes"][0].update(children=[1]), "loop"),
        (lambda d: d["nodes"][1].update(children=[0, 0]), "two parents"),
        (lambda d: d["nodes"][1].update(children=[9]), "not there"),
        (lambda d: d["nodes"][0].update(scale="big"), "scale"),
        (lambda d: d["nodes"].extend([{"mesh": 0}] * 2_000_000), "more than 20,000,000"),
        (lambda d: d.update(extensionsRequired=["KHR_draco_mesh_compression"]), "packed by KHR_draco"),
        (lambda d: d["meshes"][0]["primitives"][0]["attributes"].pop("POSITION"), "without POSITION"),
        (lambda d: d["scenes"][0].update(nodes=[99]), "not there"),
        (lambda d: d.update(accessors={"count": 1}), "accessors"),
    ],
)
def test_what_is_declared_must_be_there(changes: Any, said: str) -> None:
    document, binary = blender()
    changes(document)
    assert said in refusal(glb(document, binary))


def test_triangles_of_other_vertices_are_refused() -> None:
    document, binary = blender()
    with_nine = binary[:80] + np.array([0, 2, 9], dtype="<u2").tobytes() + binary[86:]
    assert "vertices 0 to 9, there are 4" in refusal(glb(document, with_nine))


@pytest.mark.parametrize("kept", [4, 11, 16, 30, 400, -1])
def test_a_truncated_glb_is_refused(kept: int) -> None:
    refusal(glb(*blender())[:kept])


def test_other_contents_are_refused() -> None:
    assert "version 1" in refusal(struct.pack("<4sII", b"glTF", 1, 12))
    assert "deeply" in refusal(b'{"nodes": ' + b"[" * 100_000)
    refusal(b"")
    refusal(b"[]")
    refusal(b'{"meshes": [1')
