"""Inspection of one artifact, which may be damaged."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.store import artifacts
from schemas.artifact import Schema
from schemas.manifest import ArrayEntry, Manifest


class ArrayReport(Schema):
    """One entry of the array table, with statistics of the values."""

    entry: ArrayEntry
    minimum: float | None = None
    maximum: float | None = None
    nan_count: int | None = None


class Inspection(Schema):
    """The content of an artifact, and its problems."""

    path: Path
    manifest: Manifest | None
    arrays: tuple[ArrayReport, ...]
    energies: dict[str, float]
    problems: tuple[str, ...]


def inspect(directory: Path) -> Inspection:
    """Inspect everything that can still be read, and name everything that cannot."""
    try:
        manifest = artifacts.read_manifest(directory)
    except artifacts.CorruptArtifactError as error:
        return Inspection(path=directory, manifest=None, arrays=(), energies={}, problems=(error.what,))
    contents = artifacts.read_contents(directory)
    problems = list(artifacts.file_problems(contents, manifest))
    arrays: dict[str, np.ndarray] = {}
    reports = []
    for entry in manifest.arrays:
        try:
            arrays[entry.name] = artifacts.read_entry(directory, entry, contents)
            reports.append(describe(entry, arrays[entry.name]))
        except artifacts.CorruptArtifactError as error:
            problems.append(error.what)
            reports.append(ArrayReport(entry=entry))
    energies = dict(energies_of(manifest.payload))
    history, names = arrays.get("energy_history"), manifest.payload.get("energy_names")
    if history is not None and len(history) and isinstance(names, list):
        energies |= dict(zip(map(str, names), history[-1].tolist(), strict=False))
    return Inspection(
        path=directory, manifest=manifest, arrays=tuple(reports), energies=energies, problems=tuple(problems)
    )


def describe(entry: ArrayEntry, array: np.ndarray) -> ArrayReport:
    """Describe an array by its range and its NaN count. An empty array has no range."""
    finite = array[np.isfinite(array)]
    return ArrayReport(
        entry=entry,
        minimum=float(finite.min()) if finite.size else None,
        maximum=float(finite.max()) if finite.size else None,
        nan_count=int(np.isnan(array).sum()),
    )


def energies_of(payload: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """The energies in an artifact's fields. Those of nested artifacts have their path as a prefix."""
    for name, value in payload.items():
        if name == "energies":
            yield from ((prefix + energy, amount) for energy, amount in value.items())
        elif name == "candidates":
            for candidate in value:
                frame = candidate["frame"]
                yield f"frame {frame}: E_project + E_group", candidate["e_project"] + candidate["e_group"]
        elif isinstance(value, dict):
            yield from energies_of(value, f"{prefix}{name}.")
