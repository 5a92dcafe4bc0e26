"""glTF 2.0, as .glb or as .gltf with everything in it.

It is read here rather than by trimesh, which takes 16-bit colours, sparse and normalised numbers for others without a
word. A few lines of glTF can name other files, declare any count, repeat a mesh any number of times and hold pictures
that unfold to any size. So all of that is checked before anything is read.
"""

from __future__ import annotations

import base64
import binascii
import io
import json
import struct
from collections import Counter
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float64, Int64, UInt8
from pydantic import ValidationError

from schemas.errors import first_fault
from stages.ingest.formats.cloud import as_colours
from stages.ingest.formats.gltf_document import (
    BYTES,
    COMPONENTS,
    FAN,
    POINTS,
    STRIP,
    TRIANGLES,
    Accessor,
    Document,
    Mesh,
    Node,
    Place,
    Primitive,
)
from stages.ingest.formats.mesh_pieces import MOST, Piece

MOST_PIXELS = 2**26  # of all pictures of a file
PICTURES = ("PNG", "JPEG", "WEBP")
_MAGIC, _JSON, _BINARY = b"glTF", b"JSON", b"BIN\0"
_PACKED = ("draco", "meshopt")
_WEBP = "EXT_texture_webp"
_VERTICES, _COLOURS, _UV = "POSITION", "COLOR_0", "TEXCOORD_{}"


def read_gltf(content: bytes) -> list[Piece]:
    """Read the triangles and points of a file's scene, placed by its nodes, with their colours and pictures.

    Raises ValueError for a file that is damaged, is packed, or refers to others.
    """
    text, binary = _chunks(content)
    try:
        document = Document.model_validate(json.loads(text))
    except ValidationError as error:
        raise ValueError(f"found a glTF document with {first_fault(error)}") from error
    except RecursionError as error:
        raise ValueError("found JSON nested too deeply") from error
    if packed := [name for name in document.extensionsRequired if any(word in name for word in _PACKED)]:
        raise ValueError(f"found meshes packed by {packed[0][:80]}; export it without compression")
    try:
        _check_nodes(document)
        file = _File(document, _views(document, binary))
        return list(file.pieces())
    except IndexError as error:
        raise ValueError("found the number of a buffer, accessor, mesh, material or node that is not there") from error


def _chunks(content: bytes) -> tuple[bytes, bytes]:
    """The JSON text, and the binary chunk of a .glb. The sizes in the header must be those of the content."""
    if not content.startswith(_MAGIC):
        return content, b""
    version, length = struct.unpack("<4xII", content[:12]) if len(content) >= 12 else (0, 0)
    if version != 2:
        raise ValueError(f"found glTF of version {version}, expected 2")
    if length != len(content):
        raise ValueError(f"found {len(content)} of the {length} bytes that it declares")
    chunks: dict[bytes, bytes] = {}
    place = 12
    while place + 8 <= length:
        size, kind = struct.unpack("<I4s", content[place : place + 8])
        place += 8
        if place + size > length:
            raise ValueError(f"found {length - place} of the {size} bytes that a chunk declares")
        chunks.setdefault(kind, content[place : place + size])
        place += size
    if _JSON not in chunks:
        raise ValueError("found no JSON in it")
    return chunks[_JSON], chunks.get(_BINARY, b"")


def _views(document: Document, binary: bytes) -> list[memoryview]:
    """The bytes of each buffer view."""
    buffers = [binary if buffer.uri is None else _embedded(buffer.uri) for buffer in document.buffers]
    for buffer, data in zip(document.buffers, buffers, strict=True):
        if len(data) < buffer.byteLength:
            raise ValueError(f"found {len(data)} of the {buffer.byteLength} bytes that a buffer declares")
    views = []
    for view in document.bufferViews:
        data, end = buffers[view.buffer], view.byteOffset + view.byteLength
        if end > len(data):
            raise ValueError(f"found a view up to byte {end} of a buffer of {len(data)}")
        views.append(memoryview(data)[view.byteOffset : end])
    return views


def _embedded(uri: str) -> bytes:
    """The content of a data URI. Raises ValueError for any other, which would be another file."""
    head, comma, data = uri.partition(",")
    if not (comma and head.startswith("data:") and head.endswith(";base64")):
        raise ValueError(f"found a reference to another file ({uri[:60]!r}), which is not followed; export it as .glb")
    try:
        return base64.b64decode(data, validate=True)
    except binascii.Error as error:
        raise ValueError(f"found damaged base64 ({error})") from error


def _check_nodes(document: Document) -> None:
    """Raise ValueError unless the nodes form trees and all repeats of meshes together are of a bearable size."""
    parents = Counter(child for node in document.nodes for child in node.children)
    if any(count > 1 for count in parents.values()):
        raise ValueError("found a node with two parents, expected a tree of nodes")
    sizes = [_size(document, mesh) for mesh in document.meshes]
    if sum(sizes[node.mesh] for node in document.nodes if node.mesh is not None) > MOST:
        raise ValueError(f"found more than {MOST:,} vertices and corners in all nodes; simplify it")


def _size(document: Document, mesh: Mesh) -> int:
    """The numbers that a mesh declares: its vertices, and the corners of its triangles."""
    used = [
        index for primitive in mesh.primitives for index in (primitive.attributes.get(_VERTICES), primitive.indices)
    ]
    return sum(document.accessors[index].count for index in used if index is not None)


class _File:
    """A document and the bytes of its views."""

    def __init__(self, document: Document, views: list[memoryview]) -> None:
        self.document, self.views = document, views
        self.pixels = 0
        self.pictures: dict[int, UInt8[np.ndarray, "rows columns 3"]] = {}

    def pieces(self) -> Iterator[Piece]:
        """Yield the pieces of the scene."""
        document = self.document
        children = {child for node in document.nodes for child in node.children}
        roots = [index for index in range(len(document.nodes)) if index not in children]
        if document.scenes:
            roots = document.scenes[document.scene].nodes
        seen: set[int] = set()
        open_nodes = [(root, np.eye(4)) for root in roots]
        while open_nodes:
            index, T_scene_parent = open_nodes.pop()
            if index in seen:
                raise ValueError("found nodes that form a loop, expected a tree")
            seen.add(index)
            node = document.nodes[index]
            T_scene_node = T_scene_parent @ _transform(node)
            open_nodes += [(child, T_scene_node) for child in node.children]
            if node.mesh is not None:
                for primitive in document.meshes[node.mesh].primitives:
                    if primitive.mode in (TRIANGLES, STRIP, FAN, POINTS):
                        yield self._piece(primitive, T_scene_node)

    def _piece(self, primitive: Primitive, T_scene_node: Float64[np.ndarray, "4 4"]) -> Piece:
        names = primitive.attributes
        if _VERTICES not in names:
            raise ValueError(f"found a primitive without {_VERTICES}, expected its vertices")
        vertices = self.numbers(names[_VERTICES], (3,)).astype(np.float64)
        count = len(vertices)
        order = np.arange(count) if primitive.indices is None else self.numbers(primitive.indices, (1,))[:, 0]
        triangles = _triangles(order.astype(np.int64), primitive.mode)
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < count:
            raise ValueError(f"found a triangle of vertices {triangles.min()} to {triangles.max()}, there are {count}")
        colours = picture = uv = tint = None
        if _COLOURS in names:
            colours = as_colours(self.numbers(names[_COLOURS], (3, 4), count)[:, :3])
        if primitive.material is not None:
            material = self.document.materials[primitive.material].pbrMetallicRoughness
            tint = None if material.baseColorFactor is None else np.array(material.baseColorFactor[:3])
            info = material.baseColorTexture
            if info is not None and (name := _UV.format(info.texCoord)) in names:
                picture = self._picture(info.index)
                uv = self.numbers(names[name], (2,), count).astype(np.float64)
        placed = vertices @ T_scene_node[:3, :3].T + T_scene_node[:3, 3]
        return Piece(placed, triangles, colours, picture, uv, tint)

    def numbers(self, index: int, widths: tuple[int, ...], count: int | None = None) -> np.ndarray:
        """The numbers of an accessor (count, width). Normalised whole numbers become shares from -1 to 1.

        Raises ValueError for another width or count.
        """
        accessor = self.document.accessors[index]
        width, dtype = COMPONENTS[accessor.type], np.dtype(BYTES[accessor.componentType])
        if width not in widths or count not in (None, accessor.count):
            raise ValueError(
                f"found {accessor.count} x {width} numbers, expected {count or accessor.count} x {widths[0]}"
            )
        if accessor.bufferView is None:
            values = np.zeros((accessor.count, width), dtype=dtype)
        else:
            place = Place(bufferView=accessor.bufferView, byteOffset=accessor.byteOffset)
            values = self._table(place, accessor.count, width, dtype)
        if accessor.sparse is not None:
            self._replace(values, accessor)
        if accessor.normalized and dtype.kind in "iu":
            return np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def _replace(self, values: np.ndarray, accessor: Accessor) -> None:
        """Put the sparse numbers in their places."""
        sparse = accessor.sparse
        if sparse is None or sparse.indices.componentType is None or sparse.count > accessor.count:
            raise ValueError("found sparse numbers without their places")
        where = self._table(sparse.indices, sparse.count, 1, np.dtype(BYTES[sparse.indices.componentType]))[:, 0]
        values[where.astype(np.int64)] = self._table(sparse.values, sparse.count, values.shape[1], values.dtype)

    def _table(self, place: Place, count: int, width: int, dtype: np.dtype) -> np.ndarray:
        data, row = self.views[place.bufferView], width * dtype.itemsize
        stride = self.document.bufferViews[place.bufferView].byteStride or row
        if count and place.byteOffset + (count - 1) * stride + row > len(data):
            raise ValueError(f"found {len(data)} bytes in a view, too few for {count} rows of {row}")
        table = np.ndarray((count, width), dtype, data, place.byteOffset if count else 0, (stride, dtype.itemsize))
        return table.copy()

    def _picture(self, texture: int) -> UInt8[np.ndarray, "rows columns 3"]:
        """The pixels of a texture's picture. Its format and size are checked before it is unpacked."""
        from PIL import Image

        source = self.document.textures[texture].source
        webp = self.document.textures[texture].extensions.get(_WEBP)
        if isinstance(webp, dict) and isinstance(webp.get("source"), int):
            source = webp["source"]
        if source is None or source < 0:
            raise ValueError(f"found a texture without a picture of {', '.join(PICTURES)}; export it anew")
        if source in self.pictures:
            return self.pictures[source]
        image = self.document.images[source]
        if image.uri is None and image.bufferView is None:
            raise ValueError("found a picture without its bytes")
        data = self.views[image.bufferView or 0] if image.uri is None else _embedded(image.uri)
        try:
            with Image.open(io.BytesIO(data), formats=PICTURES) as picture:
                self.pixels += picture.width * picture.height
                if self.pixels > MOST_PIXELS:
                    raise ValueError(f"found pictures of more than {MOST_PIXELS:,} pixels; make them smaller")
                self.pictures[source] = np.asarray(picture.convert("RGB"))
        except (OSError, SyntaxError, Image.DecompressionBombError) as error:
            raise ValueError(f"found a picture that is none of {', '.join(PICTURES)} ({error!r:.100})") from error
        return self.pictures[source]


def _transform(node: Node) -> Float64[np.ndarray, "4 4"]:
    """The transform of a node's coordinates to those of its parent."""
    if node.matrix is not None:
        return np.array(node.matrix, dtype=np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.rotation) / (np.linalg.norm(node.rotation) or 1.0)
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R * np.array(node.scale), node.translation
    return T


def _triangles(order: Int64[np.ndarray, "corners"], mode: int) -> Int64[np.ndarray, "triangles 3"]:
    if mode == TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    if len(order) < 3 or mode == POINTS:
        return np.zeros((0, 3), dtype=np.int64)
    first = order[:-2] if mode == STRIP else np.repeat(order[:1], len(order) - 2)
    return np.stack([first, order[1:-1], order[2:]], axis=1)
