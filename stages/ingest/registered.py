"""The sequences of D-FAUST, or of similar files, as frames with a true surface."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schemas.config import IngestConfig
from schemas.errors import InputError
from schemas.sequence import IngestedSequence
from stages.ingest.formats.dfaust import SUFFIXES, frame_count, read_registrations, sequence_digest, sequence_names
from stages.ingest.listing import is_folder, safe_name, visible_files


@dataclass(frozen=True)
class RegisteredSource:
    """A sequence of an HDF5 file; `entry` is its name there."""

    name: str
    path: Path
    entry: str

    def digest(self) -> str:
        """SHA-256 (hex) of the sequence. Raises InputError for a file that cannot be read."""
        return sequence_digest(self.path, self.entry)

    def frame_count(self, config: IngestConfig) -> None:
        """Not known before the frames are chosen."""

    def load(self, config: IngestConfig, rng: np.random.Generator) -> IngestedSequence:
        """Sample the chosen frames anew, as a normalised sequence with its true surface."""
        from stages.ingest.corresponding import chosen_frames, sampled_sequence

        where = f"{self.path}: {self.entry}"
        frames = chosen_frames(frame_count(self.path, self.entry), config, where)
        vertices, triangles = read_registrations(self.path, self.entry, frames, config.max_points)
        own_rng = np.random.default_rng([int(rng.integers(2**63)), zlib.crc32(self.name.encode())])
        names = [f"{self.path.name}: {self.entry}[{index}]" for index in frames]
        return sampled_sequence(vertices, triangles, names, config, config.units, own_rng)


def registered_sources(data: Path) -> list[RegisteredSource]:
    """List the sequences of an HDF5 file or of a folder of them. Raises InputError for none, or for repeated names."""
    files = [data]
    if is_folder(data):
        files = [file for file in visible_files(data) if file.suffix.lower() in SUFFIXES]
    if not files:
        raise InputError(
            f"{data}: found no {' or '.join(SUFFIXES)} file, expected registrations such as D-FAUST's; for .npz or "
            ".ply frames whose points correspond give --dataset scans --set ingest.correspond=true"
        )
    found: dict[str, RegisteredSource] = {}
    for file in files:
        for entry in sequence_names(file):
            source = RegisteredSource(safe_name(entry), file, entry)
            if (other := found.setdefault(source.name, source)) is not source:
                raise InputError(
                    f"{file}: found the sequence name {source.name!r} twice, expected one name each; "
                    f"it is in {other.path}, too"
                )
    return list(found.values())
