"""The records beside an artifact's arrays: its provenance and content, or why a stage failed."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import Field

from schemas.artifact import Schema
from schemas.names import Name


class Provenance(Schema):
    """How an artifact was made, in enough detail to make it again."""

    stage: Name
    version: int = Field(description="version of the stage's code; a new one makes new keys")
    dataset: Name
    sequence: Name
    key: Name = Field(description="hash of stage, version, own settings, parameters, upstream keys and seed")
    parameters: dict[str, Any] = Field(description="what distinguishes this task from others of its stage")
    config: dict[str, Any] = Field(description="the resolved configuration of the whole run that wrote this")
    upstream: dict[str, Name] = Field(description="keys of the artifacts read; for ingest the source's digest")
    seed: int
    created: datetime
    seconds: dict[str, float] = Field(description="time spent reading the inputs and computing")
    peak_memory_mib: float | None = Field(default=None, description="peak memory of the task's process, MiB")
    packages: dict[str, str] = Field(description="versions of Python and of the packages that matter")


class ArrayEntry(Schema):
    """One array of `arrays.zarr`. `name` is its path there: `points`, or `sequence/points` if nested."""

    name: str
    dtype: str
    shape: tuple[int, ...]
    dims: tuple[str, ...]
    unit: str
    digest: str = Field(description="SHA-256 of the values in C order")


class Manifest(Provenance):
    """`manifest.json`, which is written last. An artifact is complete when its manifest exists."""

    schema_version: Literal[1] = 1
    arrays: tuple[ArrayEntry, ...]
    payload: dict[str, Any] = Field(description="every field of the artifact that is not an array")
    files: dict[str, str] = Field(description="SHA-256 of every other file in the artifact's directory")
    digest: str = Field(description="SHA-256 of this manifest's canonical JSON without this field")


class Failure(Schema):
    """`<stage>-<key>.failed.json`: why the last attempt at an artifact failed. Removed when the next one starts."""

    stage: str
    key: str
    error: str = Field(description="the exception's type")
    message: str
    bad_input: bool = Field(description="the cause is the user's input, not a defect of the program")
    time: datetime
    log: str
