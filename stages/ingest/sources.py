"""The sources of sequences: the user's files, robot descriptions, people, and registrations."""

from __future__ import annotations

import hashlib
import logging
import os
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from schemas.config import IngestConfig
from schemas.errors import InputError
from schemas.sequence import IngestedSequence
from stages.ingest.assembly import assembled, every_frame
from stages.ingest.file_source import FileSource, file_source
from stages.ingest.listing import is_file, is_folder, safe_name, visible_entries
from stages.ingest.normalise import normalise, normalise_truth
from stages.ingest.readers import Frame, frame_folders
from stages.ingest.registered import registered_sources
from stages.ingest.sequences import holds_many, is_sequence

if TYPE_CHECKING:
    from stages.ingest.roboart import Description

_log = logging.getLogger("rearticulate.ingest")


class Source(Protocol):
    """One sequence that can be ingested."""

    @property
    def name(self) -> str:
        """The sequence's name, which is safe in a path."""

    def digest(self) -> str:
        """SHA-256 (hex) of everything that `load` reads. It is cheap, and imports neither torch nor Open3D."""

    def frame_count(self, config: IngestConfig) -> int | None:
        """How many frames `load` gives; None where that cannot be told without reading them."""

    def load(self, config: IngestConfig, rng: np.random.Generator) -> IngestedSequence:
        """Load the sequence in the normalised frame. Raises InputError if it cannot be used."""


@dataclass(frozen=True)
class DescribedSource(ABC):
    """A sequence that the RoboArt builder makes from a description. `variant` numbers the sequences of one object."""

    name: str
    thing: str
    variant: int

    @abstractmethod
    def description(self) -> Description:
        """Find the description. Raises InputError as `digest` does."""

    def digest(self) -> str:
        """SHA-256 (hex) of the description and the sequence's variant.

        Raises UnavailableError for a description that this machine lacks, with a message that says how to get it.
        Raises InputError for one that is not XML or lacks a mesh.
        """
        from stages.ingest.roboart import description_digest

        return hashlib.sha256(f"{description_digest(self.description())} {self.variant}".encode()).hexdigest()

    def frame_count(self, config: IngestConfig) -> int:
        """Every so many of the frames that are built."""
        return len(range(0, config.roboart.frames, config.every))

    def load(self, config: IngestConfig, rng: np.random.Generator) -> IngestedSequence:
        """The sampled frames as a normalised sequence, in metres, with full ground truth."""
        from stages.ingest.roboart import build_from_urdf

        # each object and variant has its own stream, so that objects move differently and variants do not depend on
        # their number
        own_rng = np.random.default_rng([int(rng.integers(2**63)), zlib.crc32(self.thing.encode()), self.variant])
        found = self.description()
        points, truth, viewpoints = build_from_urdf(found.urdf_path, found.mesh_dirs, config.roboart, own_rng)
        frames = [
            Frame(f"{self.name}[{index}]", of_frame, None if viewpoints is None else viewpoints[index])
            for index, of_frame in enumerate(points)
        ]
        kept = every_frame(frames, config.every)
        return assembled(kept, lambda: truth.every(config.every), config, "metre", own_rng)


@dataclass(frozen=True)
class RoboartSource(DescribedSource):
    """A sequence of one of RoboArt's robots. `assets` is a folder of descriptions, which is searched first."""

    assets: Path | None = None

    def description(self) -> Description:
        from stages.ingest.roboart import robot_description

        return robot_description(self.thing, self.assets)


@dataclass(frozen=True)
class UrdfSource(DescribedSource):
    """A sequence of the user's own object, moved and sampled as RoboArt's robots are."""

    own: Description

    def description(self) -> Description:
        return self.own


@dataclass(frozen=True)
class HumanSource:
    """A sequence of a moving person, which the name alone determines."""

    name: str

    def digest(self) -> str:
        """SHA-256 (hex) of the name and of the body model's version. Raises InputError if it is not installed."""
        from stages.ingest.humans.assets import model_version
        from stages.ingest.humans.catalogue import EDITION

        return hashlib.sha256(f"humans {EDITION} {model_version()} {self.name}".encode()).hexdigest()

    def frame_count(self, config: IngestConfig) -> int:
        """Every so many of the frames that are built."""
        return len(range(0, config.humans.frames, config.every))

    def load(self, config: IngestConfig, rng: np.random.Generator) -> IngestedSequence:
        """The sampled frames as a normalised sequence, in metres, with full ground truth."""
        from stages.ingest.humans import build_human
        from stages.ingest.tracks import normalise_surface

        own_rng = np.random.default_rng([int(rng.integers(2**63)), zlib.crc32(self.name.encode())])
        points, truth, surface = build_human(self.name, config.humans, own_rng)
        frames = [Frame(f"{self.name}[{index}]", of_frame) for index, of_frame in enumerate(points)]
        kept, step = every_frame(frames, config.every), config.every
        sequence = normalise(kept, config, "metre")
        return IngestedSequence(
            sequence=sequence,
            truth=normalise_truth(truth.every(step), kept, sequence),
            surface=normalise_surface(surface.every(step), kept, sequence),
        )


def list_sources(config: IngestConfig, data: Path | None) -> list[Source]:
    """The sequences of a configuration, in natural order of their names.

    - "roboart": every robot of the data set, even if this machine lacks its description. `data`, or else the
      environment's REART_ASSETS, is a folder of descriptions NAME/NAME.urdf, which is searched first.
    - "humans": the people of that data set.
    - "dfaust": the sequences in the HDF5 files of `data`.
    - "urdf": all descriptions that `own_descriptions` finds in `data`.
    - "files": `data` itself if it is one sequence, else its sub-folders and .npy or .npz files that are sequences.

    Raises InputError if there are none.
    """
    if config.source == "humans":
        from stages.ingest.humans.assets import model_version
        from stages.ingest.humans.catalogue import human_names

        model_version()  # if it is missing, fail once rather than for every sequence
        return [HumanSource(name) for name in human_names()]
    if config.source == "roboart":
        return _roboart_sources(config.roboart.sequences_per_robot, data)
    expected = {"urdf": "URDF files", "dfaust": "registrations (.hdf5)"}.get(config.source, "sequences")
    if data is None:
        raise InputError(
            f"ingest.source: found {config.source!r} without a folder of {expected}, expected one; "
            "give --data FOLDER (make: DATA=FOLDER)"
        )
    if not is_file(data) and not is_folder(data):
        raise InputError(f"{data}: found neither a file nor a folder there, expected {expected}; check the path")
    if config.source == "dfaust":
        return list(registered_sources(data))
    if config.source == "urdf":
        return _urdf_sources(config.roboart.sequences_per_robot, data)
    if is_file(data) or is_sequence(data, certainly=True):
        return [file_source(data)]
    found = [source for entry in visible_entries(data) if (source := _source_at(entry))]
    if not any(holds_many(source.frames_path) for source in found):
        if folders := frame_folders(data):
            raise InputError(f"{data}: {folders}")
        if is_sequence(data):
            return [file_source(data)]
    if not found:
        raise InputError(
            f"{data}: found no sequence, expected sub-folders with .ply, .pcd, .xyz, .txt, .csv, .pts or .npy frames, "
            "or .npy or .npz files of shape (frames, points, 3); check the path"
        )
    by_name: dict[str, FileSource] = {}
    for source in found:
        other = by_name.setdefault(source.name, source)
        if other is not source:
            raise _same_name(source.frames_path, other.frames_path, source.name)
    return list(found)


def _same_name(path: Path, other: Path, name: str) -> InputError:
    return InputError(f"{path}: found the sequence name {name!r} twice, expected one name each; rename this or {other}")


def _roboart_sources(per_robot: int, data: Path | None) -> list[Source]:
    from stages.ingest.roboart import ASSETS_VARIABLE, robot_names

    named = os.environ.get(ASSETS_VARIABLE)
    assets = data if data is not None or not named else Path(named)
    if assets is not None and not any((assets / robot / f"{robot}.urdf").is_file() for robot in robot_names()):
        raise InputError(
            f"{assets}: found no robot there, expected NAME/NAME.urdf for some of {', '.join(robot_names())}; "
            f"check the path (--assets or {ASSETS_VARIABLE})"
        )
    return [RoboartSource(*names, assets) for names in _variants(robot_names(), per_robot)]


def _urdf_sources(per_thing: int, data: Path) -> list[Source]:
    from stages.ingest.roboart import own_descriptions

    found: dict[str, Description] = {}
    for name, description in own_descriptions(data):
        if (other := found.setdefault(safe_name(name), description)) is not description:
            raise _same_name(description.urdf_path, other.urdf_path, safe_name(name))
    return [UrdfSource(name, thing, variant, found[thing]) for name, thing, variant in _variants(found, per_thing)]


def _variants(things: Iterable[str], per_thing: int) -> list[tuple[str, str, int]]:
    """Yield the name, the object and the variant of every sequence."""
    if per_thing == 1:
        return [(thing, thing, 0) for thing in things]
    return [(f"{thing}-{variant}", thing, variant) for thing in things for variant in range(per_thing)]


def _source_at(entry: Path) -> FileSource | None:
    """The sequence at an entry of a data set. If the system does not allow a check, loading the sequence fails."""
    try:
        if not is_sequence(entry):
            return None
        return file_source(entry) if entry.exists() else FileSource(safe_name(entry.stem), entry)
    except InputError:
        return FileSource(safe_name(entry.name), entry)
