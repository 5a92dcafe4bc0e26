"""The base of all tasks. A task runs one stage of one sequence: it reads artifacts and writes one."""

from __future__ import annotations

import contextlib
import importlib.metadata
import logging
import platform
import time
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache, cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, cast

import numpy as np

from pipeline.run.failures import one_line
from pipeline.run.isolated_luigi import luigi
from pipeline.run.logs import captured
from pipeline.run.place import Place
from pipeline.run.plugins import own_code
from pipeline.run.processes import die_with_forking_parent, peak_memory_mib
from pipeline.run.protocol import Event, Listener, ignore
from pipeline.store import artifacts
from pipeline.store.files import write_atomically
from pipeline.store.keys import artifact_key, canonical_json
from schemas.artifact import Artifact
from schemas.config import PipelineConfig
from schemas.errors import InputError
from schemas.manifest import Failure, Provenance
from stages.ingest.sources import Source
from stages.support.progress import Progress

PROGRESS_INTERVAL = 0.2  # seconds
PACKAGES = ("rearticulate", "numpy", "scipy", "torch", "open3d-cpu", "open3d", "networkx", "pykdtree", "zarr", "luigi")


@dataclass(frozen=True, eq=False, repr=False)  # Luigi calls repr on all arguments whenever a task is made
class Job:
    """One sequence to be processed, with everything that its tasks share."""

    dataset: str
    source: Source
    source_digest: str
    config: PipelineConfig
    workdir: Path
    notify: Listener = ignore
    replaces: dict[Path, int] = field(default_factory=dict)  # artifact to replace -> when it was completed
    frame_count: int | None = None  # where it is known before the frames are read

    @property
    def folder(self) -> Path:
        return self.workdir / self.dataset / self.source.name


class JobParameter(luigi.Parameter[Job]):
    """The job as a task's parameter. It is not part of a task's identity, which the key determines."""

    def __init__(self) -> None:
        super().__init__(significant=False, visibility=luigi.parameter.ParameterVisibility.PRIVATE)


@dataclass(frozen=True)
class Given:
    """The inputs of a stage besides the artifacts that it reads. The artifact's key and folder cover all of them.

    `settings` holds only the sections that the task declares; reading another one raises AttributeError. It is typed as
    the whole configuration so that types can be checked.
    """

    source: Source
    settings: PipelineConfig
    parameters: Mapping[str, Any]
    rng: np.random.Generator
    progress: Progress


class StageTask(luigi.Task):
    """One stage of one sequence. A subclass states `stage`, `version`, `schema`, `requires` and `compute`.

    `version` is VERSION of the stage's package. `also` names the sections of the configuration that `compute` reads
    besides the stage's own. Each must belong to an upstream stage: its key covers the section, and this task's key
    covers that key. `compute` and `files` are static, so that they cannot reach the job, which holds all settings.
    """

    stage: ClassVar[str]
    version: ClassVar[int]
    schema: ClassVar[type[Artifact]]
    also: ClassVar[tuple[str, ...]] = ()

    job = JobParameter()

    def requires(self) -> dict[str, StageTask]:
        """The tasks whose artifacts this one reads, by their names in `compute`'s inputs."""
        return {}

    def check(self, inputs: Mapping[str, Any]) -> None:
        """Check, before any work, that the settings of later stages suit these inputs. Raises InputError."""

    @staticmethod
    def compute(inputs: Mapping[str, Any], given: Given) -> Artifact:
        """Run the stage: compute its output from the artifacts that `requires` names."""
        raise NotImplementedError

    def parameters(self) -> dict[str, Any]:
        """The parameters that distinguish this task from others of the same stage and sequence."""
        return {}

    @staticmethod
    def files(output: Any, inputs: Mapping[str, Any], given: Given) -> dict[str, bytes]:
        """Files to store beside the arrays, for other programs and for people."""
        return {}

    def function(self) -> str:
        """The setting that may name a user's own function, `package.module:function`."""
        return ""

    def upstream_keys(self) -> dict[str, str]:
        """The keys of the artifacts that this task reads, and the digest of a user's own function."""
        return {name: task.key for name, task in self.requires().items()} | own_code(self.function())

    @property
    def settings(self) -> PipelineConfig:
        """The sections that `compute` sees: the stage's own, if there is one, and those of `also`."""
        own = (self.stage,) if self.stage in PipelineConfig.model_fields else ()
        seen = {section: getattr(self.job.config, section) for section in own + self.also}
        return cast(PipelineConfig, SimpleNamespace(**seen))

    @cached_property
    def key(self) -> str:
        own = getattr(self.settings, self.stage, None)
        return artifact_key(
            stage=self.stage,
            version=self.version,
            config=own.model_dump(mode="json") if own else {},
            parameters=self.parameters(),
            upstream=self.upstream_keys(),
            seed=self.job.config.seed,
        )

    @property
    def label(self) -> str:
        values = ", ".join(map(str, self.parameters().values()))
        return f"{self.stage}[{values}]" if values else self.stage

    @property
    def directory(self) -> Path:
        return self.job.folder / f"{self.stage}-{self.key}"

    @property
    def place(self) -> Place:
        return Place(self.job.source.name, self.label, self.directory)

    def to_str_params(self, only_significant: bool = False, only_public: bool = False) -> dict[str, str]:
        """The identity of the task for Luigi. It holds the key, which separates tasks of two configurations."""
        parameters = super().to_str_params(only_significant, only_public)
        return parameters | {"dataset": self.job.dataset, "sequence": self.job.source.name, "key": self.key}

    def complete(self) -> bool:
        """Whether the artifact exists and is not to be replaced by a rerun. Costs one stat.

        Raises UnreadableArtifactError.
        """
        return artifacts.completed_at(self.directory) not in (None, self.job.replaces.get(self.directory))

    def read(self) -> Artifact:
        """Read and check the artifact. Raises ArtifactError."""
        return artifacts.read(self.directory, self.schema)

    def run(self) -> None:
        """Read, compute and publish in a worker process, and report the outcome."""
        die_with_forking_parent()
        start = time.perf_counter()
        self.tell("started")
        try:
            self.place.failure.unlink(missing_ok=True)
            with captured(self.place.log, lambda message: self.tell("warning", message=message)):
                self._make_logged()
        except (Exception, SystemExit) as error:
            self.fail(error)
            raise
        self.tell("finished", seconds=time.perf_counter() - start)

    def fail(self, error: BaseException) -> None:
        """Report that this attempt failed, and record the failure if possible."""
        bad_input = isinstance(error, InputError)
        self.tell("failed", message=one_line(error), bad_input=bad_input)
        failure = Failure(
            stage=self.stage,
            key=self.key,
            error=type(error).__name__,
            message=one_line(error),
            bad_input=bad_input,
            time=datetime.now(UTC),
            log=self.place.log.name,
        )
        with contextlib.suppress(OSError):  # the disk itself may have failed
            self.directory.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self.place.failure, failure.model_dump_json(indent=1).encode() + b"\n")

    def tell(self, kind: str, **news: Any) -> None:
        """Report an event of this task."""
        identity = {"sequence": self.job.source.name, "task": self.label, "artifact": self.directory.name}
        self.job.notify(Event.model_validate({"kind": kind, **identity, **news}))

    def _make_logged(self) -> None:
        try:
            self._make()
        except (Exception, SystemExit):
            logging.exception("%s of %s failed", self.label, self.job.source.name)
            raise

    def _make(self) -> None:
        start = time.perf_counter()
        inputs = {name: task.read() for name, task in self.requires().items()}
        read = time.perf_counter()
        self.check(inputs)
        given = Given(self.job.source, self.settings, self.parameters(), self._generator(), self._progress())
        output = self.compute(inputs, given)
        files = self.files(output, inputs, given)
        computed = time.perf_counter()
        config = self.job.config
        provenance = Provenance(
            stage=self.stage,
            version=self.version,
            dataset=self.job.dataset,
            sequence=self.job.source.name,
            key=self.key,
            parameters=self.parameters(),
            config=config.model_dump(mode="json"),
            upstream=self.upstream_keys(),
            seed=config.seed,
            created=datetime.now(UTC),
            seconds={"read": read - start, "compute": computed - read},
            peak_memory_mib=peak_memory_mib(),
            packages=package_versions(),
        )
        artifacts.publish(self.directory, output, provenance, files, replaces=self.job.replaces.get(self.directory))

    def _generator(self) -> np.random.Generator:
        """A generator of this task alone, so that the number and order of workers do not matter."""
        identity = zlib.crc32(canonical_json([self.stage, self.parameters()]).encode())
        return np.random.default_rng([self.job.config.seed, identity])

    def _progress(self) -> Progress:
        last = 0.0

        def progress(done: int, total: int, energy: float | None = None) -> None:
            nonlocal last
            now = time.monotonic()
            if now - last >= PROGRESS_INTERVAL:
                last = now
                self.tell("progress", done=done, total=total, energy=energy)

        return progress


def upstream_first(tasks: Iterable[StageTask]) -> list[StageTask]:
    """The tasks and all that they need. Each comes once, after the ones that it needs."""
    ordered: dict[StageTask, None] = {}

    def add(task: StageTask) -> None:
        if task not in ordered:
            for needed in task.requires().values():
                add(needed)
            ordered[task] = None

    for task in tasks:
        add(task)
    return list(ordered)


@cache
def package_versions() -> dict[str, str]:
    """The versions of Python and of relevant packages. They are looked up once, since that reads many files."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions
