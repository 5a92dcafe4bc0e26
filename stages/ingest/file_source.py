"""The user's own files as a source: a folder of frames, of depth images, or one array."""

from __future__ import annotations

import hashlib
import logging
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from schemas.config import IngestConfig
from schemas.errors import InputError
from schemas.sequence import IngestedSequence, LengthUnit
from stages.ingest.assembly import assembled, every_frame
from stages.ingest.depth_folder import declared_depth_frames, depth_files, is_depth_folder, read_depth_frames
from stages.ingest.formats.mesh_pieces import MeshSampling
from stages.ingest.listing import is_file, is_folder, safe_name
from stages.ingest.messages import unreadable
from stages.ingest.readers import Frame, declared_frames, frame_files, read_frames
from stages.ingest.roboart_pickles import has_transforms
from stages.ingest.sequences import FRAMES_NAME, TRUTH_NAME, holds_frames
from stages.ingest.truth import read_truth, truth_files

_log = logging.getLogger("rearticulate.ingest")

_MANY_FRAMES = 200
_ENOUGH_FRAMES = 50
_SECONDS_PER_FRAME = 2.8  # measured for 4096 points on two cores


@dataclass(frozen=True)
class FileSource:
    """A folder of frames or one array, and the file or folder of the ground truth if there is one."""

    name: str
    frames_path: Path
    truth_path: Path | None = None

    def digest(self) -> str:
        """SHA-256 (hex) of the contents and names of the frames and of the ground truth.

        `load` reports missing and invalid content. Raises InputError for an unreadable file.
        """
        path = self.frames_path
        names: dict[Path, str] = {}
        frames = [path]
        if is_depth_folder(path):
            frames = depth_files(path)
            names = {file: file.relative_to(path).as_posix() for file in frames}
        elif is_folder(path):
            frames = frame_files(path)
        truth = truth_files(self.truth_path) if self.truth_path else []
        total = hashlib.sha256()
        for role, files in (("frame", frames), ("truth", truth)):
            for file in filter(is_file, files):
                total.update(role.encode() + os.fsencode(names.get(file, file.name)) + b"\0" + _file_digest(file))
        return total.hexdigest()

    def frame_count(self, config: IngestConfig) -> int | None:
        """Every so many of the frames that names and headers declare."""
        path = self.frames_path
        declared = declared_depth_frames(path) if is_depth_folder(path) else declared_frames(path)
        return None if declared is None else len(range(0, declared, config.every))

    def load(self, config: IngestConfig, rng: np.random.Generator) -> IngestedSequence:
        """Load the frames as a normalised sequence, with the ground truth beside them or in their correspondence."""
        if config.correspond:
            from stages.ingest.corresponding import read_corresponding

            return read_corresponding(self.frames_path, self.truth_path, config, rng)
        units = self._units(config)
        if self.truth_path is None:
            frames = self._read(config, config.every, rng)
            _hint_at_every(len(frames))
            return assembled(frames, None, config, units, rng)
        frames = self._read(config, 1, rng)  # all frames, since the truth is for all
        kept = every_frame(frames, config.every)
        _hint_at_every(len(kept))
        truth_path, point_counts = self.truth_path, [len(frame.points) for frame in frames]
        return assembled(kept, lambda: read_truth(truth_path, point_counts).every(config.every), config, units, rng)

    def _units(self, config: IngestConfig) -> LengthUnit:
        """The unit of the coordinates. Raises InputError where depth images are to be in another one than metres."""
        if not is_depth_folder(self.frames_path):
            return config.units
        if config.units not in ("unknown", "metre"):
            raise InputError(
                f"ingest.units: found {config.units}, expected metre, in which depth images are read; "
                "state their steps by ingest.depth.units_per_metre"
            )
        return "metre"

    def _read(self, config: IngestConfig, every: int, rng: np.random.Generator) -> list[Frame]:
        """Read every `every`-th frame, with its viewpoints if they are known."""
        path, p_viewpoint = self.frames_path, config.viewpoint
        if is_depth_folder(path):
            if p_viewpoint is not None:
                raise InputError(
                    "ingest.viewpoint: found one for depth images, whose cameras are known; leave it out (--viewpoint)"
                )
            return read_depth_frames(path, config.depth, every, config.max_points)
        sampling = None
        if config.mesh.take == "surface":
            sampling = MeshSampling(config.mesh.points, rng, config.mesh.max_mib)
        frames = read_frames(path, every, config.max_points, sampling)
        if p_viewpoint is None:
            return frames
        return [replace(frame, viewpoints=np.array([p_viewpoint])) for frame in frames]


def file_source(path: Path) -> FileSource:
    """The sequence at `path`, which is one array, a folder of frames, or a folder that holds a folder `frames`.

    The ground truth is ground_truth.npz beside the frames or beside the folder `frames`, or the original RoboArt's
    pickles. Nothing is read yet. Loading reports a path without frames.
    """
    folder = path.resolve()
    if not is_folder(folder):
        return FileSource(safe_name(folder.stem), path)
    frames, sequence = path, folder
    if folder.name == FRAMES_NAME:
        sequence = folder.parent
    elif not is_depth_folder(path) and holds_frames(path / FRAMES_NAME):
        frames = path / FRAMES_NAME
    truth = next((file for file in (frames / TRUTH_NAME, sequence / TRUTH_NAME) if is_file(file)), None)
    if truth is None and has_transforms(frames):
        truth = frames
    return FileSource(safe_name(sequence.name), frames, truth)


def _hint_at_every(count: int) -> None:
    """Suggest to use fewer frames if there are many."""
    if count > _MANY_FRAMES:
        _log.warning(
            "%d frames take about %d minutes or more; a few dozen do as well: --set ingest.every=%d takes every %d-th",
            count,
            round(count * _SECONDS_PER_FRAME / 60),
            count // _ENOUGH_FRAMES,
            count // _ENOUGH_FRAMES,
        )


def _file_digest(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").digest()
    except OSError as error:
        raise unreadable(path, error) from error
