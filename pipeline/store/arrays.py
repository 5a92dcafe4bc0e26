"""The two halves of an artifact on disk: its arrays in a zarr group, and everything else as JSON.

In zarr 3.1.6 a missing or half-written chunk reads silently as the fill value, and plain zstd accepts a flipped bit.
So empty chunks are written too, chunks carry checksums, and the manifest has a digest of every array's values.

One chunk per frame, with all chunks of an array in one shard, was fastest. An array of one chunk has no shard, which
would only cost time. Reading and writing go through memory, because zarr uses a thread for each file on disk, which
takes longer than everything else for a small array.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from schemas.artifact import ArraySpec, Artifact
from schemas.manifest import ArrayEntry

if TYPE_CHECKING:
    import zarr
    from zarr.abc.buffer import Buffer

ROWS_PER_CHUNK = 65_536

AnyArtifact = TypeVar("AnyArtifact", bound=Artifact)


def arrays_of(artifact: Artifact, prefix: str = "") -> Iterator[tuple[str, ArraySpec, np.ndarray]]:
    """Yield (path, specification, array) of every array of an artifact and of its nested artifacts."""
    specs = {spec.name: spec for spec in artifact.array_specs()}
    for name, array in artifact.arrays().items():
        yield prefix + name, specs[name], array
    for name, nested in _nested(artifact):
        yield from arrays_of(nested, f"{prefix}{name}/")


def payload_of(artifact: Artifact) -> dict[str, Any]:
    """Every field that is not an array, as JSON. Nested artifacts become nested objects."""
    payload = artifact.model_dump(mode="json", exclude={*artifact.arrays(), *(name for name, _ in _nested(artifact))})
    return payload | {name: payload_of(nested) for name, nested in _nested(artifact)}


def assemble(schema: type[AnyArtifact], payload: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> AnyArtifact:
    """Make an artifact from its two halves. Raises pydantic.ValidationError if they do not fit the schema."""
    values = _copy(payload)
    for path, array in arrays.items():
        *parents, name = path.split("/")
        node = values
        for parent in parents:
            node = node[parent]
        node[name] = array
    return schema.model_validate(values)


def pack(arrays: Iterable[tuple[str, ArraySpec, np.ndarray]]) -> tuple[dict[str, bytes], tuple[ArrayEntry, ...]]:
    """Pack arrays into a new zarr group: its files by their path in it, and the manifest's array table."""
    import zarr
    from zarr.storage import MemoryStore

    packed: dict[str, Buffer] = {}
    group = zarr.create_group(MemoryStore(packed))
    entries = tuple(_write_array(group, path, spec, array) for path, spec, array in arrays)
    return {path: packed[path].to_bytes() for path in sorted(packed)}, entries


def read_array(files: Mapping[str, bytes], entry: ArrayEntry) -> np.ndarray:
    """Read one array from a group's files. Raises ValueError if it differs from its entry in the array table."""
    import zarr
    from zarr.buffer import cpu
    from zarr.storage import MemoryStore

    packed: dict[str, Buffer] = {path: cpu.Buffer.from_bytes(content) for path, content in files.items()}
    stored = zarr.open_array(MemoryStore(packed, read_only=True), mode="r", zarr_format=3)
    if (found := (stored.dtype.name, stored.shape)) != (entry.dtype, entry.shape):
        raise ValueError(f"found dtype and shape {found}, expected {(entry.dtype, entry.shape)}")
    if stored.nchunks_initialized != stored.nchunks:
        raise ValueError(f"{stored.nchunks - stored.nchunks_initialized} of {stored.nchunks} chunks are missing")
    array = np.asarray(stored[...])
    if _digest(array) != entry.digest:
        raise ValueError("its values are not those that were written (their digest differs)")
    return array


def _write_array(group: zarr.Group, path: str, spec: ArraySpec, array: np.ndarray) -> ArrayEntry:
    from zarr.codecs import ZstdCodec

    chunks = _chunk_shape(spec.dims, array.shape)
    whole = tuple(-(-size // chunk) * chunk for size, chunk in zip(array.shape, chunks, strict=True))
    group.create_array(
        path,
        shape=array.shape,
        dtype=array.dtype,
        chunks=chunks,
        shards=whole if array.size and whole != chunks else None,
        compressors=[ZstdCodec(level=3, checksum=True)],
        config={"write_empty_chunks": True},
    )[...] = array
    return ArrayEntry(
        name=path, dtype=array.dtype.name, shape=array.shape, dims=spec.dims, unit=spec.unit, digest=_digest(array)
    )


def _chunk_shape(dims: tuple[str, ...], shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape of a chunk: one frame if the first axis is frames, else a block of rows."""
    rows = 1 if dims[0] == "frames" else ROWS_PER_CHUNK
    return tuple(max(1, size) for size in (min(rows, shape[0]), *shape[1:]))


def _digest(array: np.ndarray) -> str:
    return hashlib.sha256(array.tobytes()).hexdigest()


def _nested(artifact: Artifact) -> list[tuple[str, Artifact]]:
    fields = ((name, getattr(artifact, name)) for name in type(artifact).model_fields)
    return [(name, value) for name, value in fields if isinstance(value, Artifact)]


def _copy(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Copy the objects of a JSON tree, so that arrays can be put into them. Lists are shared."""
    return {name: _copy(value) if isinstance(value, Mapping) else value for name, value in tree.items()}
