"""Reading a fitted model back from model.json and model.npz in one folder."""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from pipeline.store import artifacts
from pipeline.store.files import read_whole
from schemas.errors import InputError, first_fault
from schemas.model_file import ModelFile, Result
from schemas.seal import file_sha256, intact
from schemas.sequence import IngestedSequence

_log = logging.getLogger("rearticulate.model_folder")

ARRAYS = ("canonical_points", "labels", "T_frame_canonical")
OPTIONAL_ARRAYS = ("colours",)


def read_model_folder(folder: Path) -> Result:
    """Read the model in a folder that `reart fit` or the result stage wrote.

    Raises InputError for a file that is missing, unreadable, changed or not a model of a known version.
    """
    json_path, npz_path = folder / "model.json", folder / "model.npz"
    for path in (json_path, npz_path):
        if not path.is_file():
            raise InputError(f"{path}: not found, expected a folder with model.json and model.npz; check the path")
    try:
        _check_artifact(folder)
        model = _read_model(json_path, file_sha256(npz_path))
    except OSError as error:
        raise InputError(f"{error.filename or folder}: cannot be read ({error.strerror}); mend that first") from error
    from stages.ingest.readers import load_npz  # the command line loads stages only where it needs them

    arrays = load_npz(npz_path)
    if missing := [name for name in ARRAYS if name not in arrays]:
        raise InputError(f"{npz_path}: found no {missing[0]}, expected {', '.join(ARRAYS)}; fit the model anew")
    try:
        found = {name: arrays[name] for name in (*ARRAYS, *OPTIONAL_ARRAYS) if name in arrays}
        result = Result(model=model, **found)
    except ValidationError as error:
        raise InputError(f"{npz_path}: {first_fault(error)}; fit the model anew") from error
    if not len(result.labels):
        raise InputError(f"{npz_path}: labels: found none, expected one for each point; fit the model anew")
    for part, count in zip(model.parts, np.bincount(result.labels, minlength=len(model.parts)), strict=True):
        if part.point_count != count:
            raise InputError(
                f"{json_path}: parts.{part.id}.point_count: found {part.point_count}, expected {count} as the labels "
                "of model.npz have; take both files from one fit, or correct it"
            )
    return result


def _check_artifact(folder: Path) -> None:
    """Raise InputError if the folder is a result's artifact that differs from its manifest."""
    directory = folder.resolve()
    if directory.name.startswith("result-") and artifacts.completed_at(directory) is not None:
        try:
            artifacts.read_files(directory)
        except artifacts.CorruptArtifactError as error:
            raise InputError(f"{folder}: {error.what}; compute it anew with `reart rerun result`") from error


def _read_model(path: Path, npz_digest: str) -> ModelFile:
    """Read model.json and check its digest and that of model.npz. Older files hold no digests."""
    try:
        content = read_whole(path)
        model = ModelFile.model_validate_json(content)
    except ValidationError as error:
        raise InputError(f"{path}: {first_fault(error)}; expected a model of version 1 or 2, fit it anew") from error
    if model.json_sha256 is not None and not intact(content, model.json_sha256):
        raise InputError(
            f"{path}: its bytes were changed (json_sha256 differs); fit the model anew, "
            "or take the line json_sha256 out if the change is yours"
        )
    if model.npz_sha256 not in (None, npz_digest):
        raise InputError(
            f"{path.with_name('model.npz')}: damaged, or of another model (npz_sha256 of model.json differs); "
            "take both files from one fit, or fit the model anew"
        )
    return model


def ingested_of_model(folder: Path, result: Result) -> IngestedSequence | None:
    """The sequence that a model was fitted to, with its truth; None if its artifacts are no longer available.

    `folder` is a result's artifact, or holds one of the same model in `workdir/`, as `reart fit` leaves it.
    """
    model = (folder / "model.json").read_bytes()
    for place in (folder, *sorted(folder.glob("workdir/*/*/result-*/"))):
        with contextlib.suppress(OSError, KeyError, artifacts.UnreadableArtifactError):
            if (place / "model.json").read_bytes() == model and artifacts.completed_at(place) is not None:
                ingested = _ingested(place.resolve())
                if ingested is not None and ingested.sequence.frame_count == result.model.frames:
                    return ingested
    return None


def _ingested(result: Path) -> IngestedSequence | None:
    """The sequence that a result was made from. None if it is gone or damaged; damage causes a warning."""
    try:
        ingest = result.with_name(f"ingest-{artifacts.read_manifest(result).upstream['ingest']}")
        return None if artifacts.completed_at(ingest) is None else artifacts.read(ingest, IngestedSequence)
    except artifacts.ArtifactError as error:
        _log.warning("warning: %s", error)
        return None
