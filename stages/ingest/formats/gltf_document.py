"""What matters of a glTF document: the keys that are read, with their types. All others are ignored."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, PositiveInt

BYTES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # types of components
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
TRIANGLES, STRIP, FAN, POINTS = 4, 5, 6, 0  # modes of primitives that are read

Reals3 = tuple[float, float, float]
Reals4 = tuple[float, float, float, float]
Index = NonNegativeInt


class _Part(BaseModel):
    model_config = ConfigDict(allow_inf_nan=False)


class Buffer(_Part):
    byteLength: NonNegativeInt
    uri: str | None = None


class View(_Part):
    buffer: Index
    byteOffset: NonNegativeInt = 0
    byteLength: NonNegativeInt
    byteStride: PositiveInt | None = None


class Place(_Part):
    """Where the indices or values of sparse numbers lie."""

    bufferView: Index
    byteOffset: NonNegativeInt = 0
    componentType: Literal[5120, 5121, 5122, 5123, 5125, 5126] | None = None


class Sparse(_Part):
    count: NonNegativeInt
    indices: Place
    values: Place


class Accessor(_Part):
    bufferView: Index | None = None
    byteOffset: NonNegativeInt = 0
    componentType: Literal[5120, 5121, 5122, 5123, 5125, 5126]
    count: NonNegativeInt
    type: Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]
    normalized: bool = False
    sparse: Sparse | None = None


class Primitive(_Part):
    attributes: dict[str, Index]
    indices: Index | None = None
    material: Index | None = None
    mode: NonNegativeInt = TRIANGLES


class Mesh(_Part):
    primitives: list[Primitive]


class Node(_Part):
    mesh: Index | None = None
    children: list[Index] = Field(default_factory=list)
    matrix: Annotated[list[float], Field(min_length=16, max_length=16)] | None = None
    translation: Reals3 = (0, 0, 0)
    rotation: Reals4 = (0, 0, 0, 1)
    scale: Reals3 = (1, 1, 1)


class Scene(_Part):
    nodes: list[Index] = Field(default_factory=list)


class Image(_Part):
    uri: str | None = None
    bufferView: Index | None = None


class Texture(_Part):
    source: Index | None = None
    extensions: dict[str, Any] = Field(default_factory=dict)


class TextureInfo(_Part):
    index: Index
    texCoord: NonNegativeInt = 0


class Colouring(_Part):
    baseColorFactor: Reals4 | None = None
    baseColorTexture: TextureInfo | None = None


class Material(_Part):
    pbrMetallicRoughness: Colouring = Colouring()


class Document(_Part):
    """The document of a .gltf or .glb file."""

    scene: Index = 0
    scenes: list[Scene] = Field(default_factory=list)
    nodes: list[Node] = Field(default_factory=list)
    meshes: list[Mesh] = Field(default_factory=list)
    materials: list[Material] = Field(default_factory=list)
    textures: list[Texture] = Field(default_factory=list)
    images: list[Image] = Field(default_factory=list)
    accessors: list[Accessor] = Field(default_factory=list)
    bufferViews: list[View] = Field(default_factory=list)
    buffers: list[Buffer] = Field(default_factory=list)
    extensionsRequired: list[str] = Field(default_factory=list)
