"""The artifact store: `workdir/<dataset>/<sequence>/<stage>-<key>/`, one directory for each artifact.

An artifact is written into a staging directory beside its place, `manifest.json` last, and then moved to its place by
one `os.rename`. So a directory with a manifest holds a whole artifact. A killed process leaves at most a staging
directory, which the next run removes. Reading checks everything against the manifest.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import shutil
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import ValidationError

from pipeline.store.arrays import AnyArtifact, arrays_of, assemble, pack, payload_of, read_array
from pipeline.store.files import ANY_PARTIAL, naming_file, remove_abandoned
from pipeline.store.keys import canonical_json
from schemas.artifact import Artifact
from schemas.errors import first_fault
from schemas.manifest import ArrayEntry, Manifest, Provenance
from schemas.seal import sha256

MANIFEST = "manifest.json"
ARRAYS = "arrays.zarr"
STAGING = ".staging-"
REPLACED = ".replaced-"


class ArtifactError(Exception):
    """A stored artifact cannot be used. The message is one line: the place, the problem, and what to do."""

    advice: ClassVar[str]

    def __init__(self, directory: Path, what: str) -> None:
        self.what = what
        super().__init__(f"{directory}: {what}; {self.advice}")


class CorruptArtifactError(ArtifactError):
    """An artifact is not what was written."""

    advice = (
        "the artifact is not used: remove this folder and give the same command again, "
        "or compute it anew with `reart rerun`"
    )


class UnreadableArtifactError(ArtifactError):
    """This process could not read an artifact, which may be intact: it lacks memory, threads, files or permission."""

    advice = "the artifact may be sound and stays as it is: see to that, and give the same command again"


GONE = (FileNotFoundError, NotADirectoryError, IsADirectoryError)


def artifact_error(directory: Path, error: Exception, where: str = "") -> ArtifactError:
    """Convert an exception while reading: the artifact is corrupt, or this process could not read it."""
    said = error.strerror if isinstance(error, OSError) else None
    what = " ".join((said or str(error)).split()) or type(error).__name__
    of_process = isinstance(error, OSError | MemoryError) and not isinstance(error, GONE)
    kind = UnreadableArtifactError if of_process or "start new thread" in what else CorruptArtifactError
    return kind(directory, f"{where}: {what}" if where else what)


def completed_at(directory: Path) -> int | None:
    """The time at which the artifact was completed, in nanoseconds; None if it is incomplete. Costs one stat.

    Raises UnreadableArtifactError if this process lacks permission.
    """
    try:
        return os.stat(directory / MANIFEST).st_mtime_ns
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise artifact_error(directory, error, MANIFEST) from error


def publish(
    directory: Path,
    artifact: Artifact,
    provenance: Provenance,
    files: Mapping[str, bytes] | None = None,
    replaces: int | None = None,
) -> None:
    """Write an artifact, with further `files` beside its arrays, and move it to `directory`.

    If another process has completed the artifact meanwhile, that one is kept: the same key means the same content.
    Only an artifact completed at the time `replaces` is replaced, and it stays untouched until the move.
    """
    packed, entries = pack(arrays_of(artifact))
    contents = {f"{ARRAYS}/{name}": content for name, content in packed.items()} | dict(files or {})
    with naming_file(directory), _staging(directory) as staged:
        for name, bytes_ in contents.items():
            (staged / name).parent.mkdir(parents=True, exist_ok=True)
            (staged / name).write_bytes(bytes_)
        content = {
            **provenance.model_dump(mode="json"),
            "schema_version": 1,
            "arrays": [entry.model_dump(mode="json") for entry in entries],
            "payload": payload_of(artifact),
            "files": {name: sha256(contents[name]) for name in sorted(contents)},
        }
        manifest = Manifest.model_validate(content | {"digest": _content_digest(content)})
        (staged / MANIFEST).write_text(json.dumps(manifest.model_dump(mode="json"), indent=1) + "\n")
        _sync(staged / MANIFEST)  # damage of other files by a power cut is found on reading
        _move_into_place(staged, directory, replaces)


def read(directory: Path, schema: type[AnyArtifact]) -> AnyArtifact:
    """Read and check an artifact.

    Raises CorruptArtifactError if it is not what was written, and UnreadableArtifactError if this process cannot
    check that.
    """
    manifest = read_manifest(directory)
    contents = _checked_contents(directory, manifest)
    arrays = {entry.name: read_entry(directory, entry, contents) for entry in manifest.arrays}
    try:
        return assemble(schema, manifest.payload, arrays)
    except ValidationError as error:
        raise CorruptArtifactError(directory, f"not a {schema.__name__}: {first_fault(error)}") from error
    except KeyError as error:
        raise CorruptArtifactError(directory, f"not a {schema.__name__}: found no array {error}") from error


def read_files(directory: Path) -> dict[str, bytes]:
    """Read and check every file of an artifact but the manifest, by its path. Raises as `read` does."""
    return _checked_contents(directory, read_manifest(directory))


def read_manifest(directory: Path) -> Manifest:
    """Read and check a manifest. Raises ArtifactError."""
    try:
        content = json.loads((directory / MANIFEST).read_bytes())
        manifest = Manifest.model_validate(content)
    except ValidationError as error:
        raise CorruptArtifactError(directory, f"{MANIFEST}: {first_fault(error)}") from error
    except (ValueError, RecursionError) as error:
        raise CorruptArtifactError(directory, f"{MANIFEST}: not readable as JSON ({error})") from error
    except (OSError, MemoryError) as error:
        raise artifact_error(directory, error, MANIFEST) from error
    if content.pop("digest") != _content_digest(content):
        raise CorruptArtifactError(directory, f"{MANIFEST}: its content was changed (its digest differs)")
    if directory.name != f"{manifest.stage}-{manifest.key}":
        raise CorruptArtifactError(directory, f"{MANIFEST}: belongs to {manifest.stage}-{manifest.key}")
    return manifest


def read_contents(directory: Path) -> dict[str, bytes]:
    """Every file of an artifact but the manifest, by its path inside the directory. Raises ArtifactError."""
    try:
        files = sorted(path for path in _walk(directory) if path.is_file() and path != directory / MANIFEST)
        return {path.relative_to(directory).as_posix(): path.read_bytes() for path in files}
    except (OSError, MemoryError) as error:
        raise artifact_error(directory, error) from error


def _walk(directory: Path) -> Iterator[Path]:
    """Yield the files below a folder. Unlike `rglob`, raises OSError for a folder that cannot be listed."""

    def give_up(error: OSError) -> None:
        raise error

    for folder, _, names in os.walk(directory, onerror=give_up):
        yield from (Path(folder, name) for name in names)


def read_entry(directory: Path, entry: ArrayEntry, contents: Mapping[str, bytes]) -> np.ndarray:
    """Read and check one array from an artifact's contents. Raises ArtifactError."""
    within = f"{ARRAYS}/{entry.name}/"
    files = {name.removeprefix(within): content for name, content in contents.items() if name.startswith(within)}
    try:
        return read_array(files, entry)
    except Exception as error:  # zarr and its codecs raise anything for a broken file
        raise artifact_error(directory, error, f"{ARRAYS}/{entry.name}") from error


def file_problems(contents: Mapping[str, bytes], manifest: Manifest) -> Iterator[str]:
    """The problems of an artifact's files, one line each."""
    found = {name: sha256(content) for name, content in contents.items()}
    for name in sorted(found.keys() | manifest.files.keys()):
        if name not in found:
            yield f"{name}: missing"
        elif name not in manifest.files:
            yield f"{name}: not part of what was written"
        elif found[name] != manifest.files[name]:
            yield f"{name}: its bytes were changed (its digest differs)"


def _checked_contents(directory: Path, manifest: Manifest) -> dict[str, bytes]:
    contents = read_contents(directory)
    if problem := next(file_problems(contents, manifest), None):
        raise CorruptArtifactError(directory, problem)
    return contents


def sweep(workdir: Path) -> None:
    """Remove the remains of killed processes. Restore an artifact that one had moved aside but not replaced.

    A living writer holds a lock on its staging directory, so those of other runs are left alone.
    """
    remove_abandoned(workdir.glob(f"*/*/{ANY_PARTIAL}"))
    for staged in workdir.glob(f"*/*/{STAGING}*"):
        with contextlib.suppress(OSError), _opened(staged) as handle:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(staged)
    for aside in workdir.glob(f"*/*/{REPLACED}*"):
        directory = aside.with_name(aside.name.removeprefix(REPLACED).rpartition("-")[0])
        with contextlib.suppress(OSError):
            if completed_at(directory) is None:
                os.rename(aside, directory)
            else:
                shutil.rmtree(aside)


@contextlib.contextmanager
def _staging(directory: Path) -> Iterator[Path]:
    """A new directory beside `directory`, which is locked against sweepers and removed at the end."""
    directory.parent.mkdir(parents=True, exist_ok=True)
    staged, handle = _locked_directory(directory)
    try:
        yield staged
    finally:
        shutil.rmtree(staged, ignore_errors=True)
        os.close(handle)


def _locked_directory(directory: Path) -> tuple[Path, int]:
    while True:
        staged = _beside(directory, STAGING)
        staged.mkdir()
        try:
            handle = os.open(staged, os.O_RDONLY)
        except FileNotFoundError:
            continue  # a sweeper was faster
        with contextlib.suppress(OSError):  # on a file system without locks nobody sweeps either
            fcntl.flock(handle, fcntl.LOCK_EX)
        if staged.exists():
            return staged, handle
        os.close(handle)


def _move_into_place(staged: Path, directory: Path, replaces: int | None) -> None:
    while True:
        try:
            os.rename(staged, directory)
            break
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        if completed_at(directory) not in (None, replaces):
            return
        aside = _beside(directory, REPLACED)
        os.rename(directory, aside)
    _sync(directory.parent)
    for old in directory.parent.glob(f"{REPLACED}{directory.name}-*"):
        shutil.rmtree(old, ignore_errors=True)


def _beside(directory: Path, prefix: str) -> Path:
    return directory.with_name(f"{prefix}{directory.name}-{uuid.uuid4().hex[:8]}")


def _content_digest(content: Mapping[str, object]) -> str:
    return sha256(canonical_json(content).encode())


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[int]:
    handle = os.open(path, os.O_RDONLY)
    try:
        yield handle
    finally:
        os.close(handle)


def _sync(path: Path) -> None:
    with _opened(path) as handle:
        os.fsync(handle)
