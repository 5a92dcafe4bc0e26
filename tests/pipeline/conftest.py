"""A pipeline of three tiny stages that stands in for the real one."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from jaxtyping import Float64

from pipeline.isolated_luigi import luigi
from pipeline.protocol import Event
from pipeline.task import Job, StageTask
from schemas.artifact import Artifact, Unit
from schemas.config import PipelineConfig
from schemas.errors import InputError


class Numbers(Artifact):
    values: Annotated[Float64[np.ndarray, "rows"], Unit("1")]


@dataclass(frozen=True)
class NumberSource:
    """Stands in for a source of sequences; `refuses` makes it bad input."""

    name: str = "box"
    content: str = "content"
    refuses: str = ""

    def digest(self) -> str:
        if self.refuses == "digest":
            raise InputError(f"{self.name}: cannot be read")
        return self.content


class FirstTask(StageTask):
    stage, version, schema = "ingest", 1, Numbers

    def upstream_keys(self):
        return {"source": self.job.source_digest}

    def compute(self, inputs, rng, progress):
        print("a word on standard output")
        logging.getLogger("rearticulate.test").warning("three points were dropped")
        if self.job.source.refuses == "load":
            raise InputError("frame.ply: found\nnothing")
        for step in range(100):
            progress(step, 100, 1.0 / (step + 1))
        return Numbers(values=rng.normal(size=4))


class MiddleTask(StageTask):
    stage, version, schema = "merging", 1, Numbers
    candidate = luigi.IntParameter()

    def parameters(self):
        return {"candidate": self.candidate}

    def requires(self):
        return {"first": FirstTask(job=self.job)}

    def compute(self, inputs, rng, progress):
        return Numbers(values=inputs["first"].values + rng.normal(size=4))


class LastTask(StageTask):
    stage, version, schema = "final_fit", 1, Numbers

    def requires(self):
        return {f"middle {i}": MiddleTask(job=self.job, candidate=i) for i in range(2)}

    def compute(self, inputs, rng, progress):
        return Numbers(values=np.concatenate([inputs["middle 0"].values, inputs["middle 1"].values]))

    def files(self, output):
        return {"model.json": b"{}"}


@dataclass(frozen=True)
class TinyPipeline:
    """Jobs in one working directory, and the events that their tasks report."""

    workdir: Path
    events: list[Event]

    def job(self, config: PipelineConfig | None = None, source: NumberSource | None = None) -> Job:
        source = source or NumberSource()
        return Job("scans", source, source.content, config or PipelineConfig(), self.workdir, self.events.append)

    def tasks(self, job: Job) -> list[StageTask]:
        """All tasks of a job, each after what it needs."""
        return [FirstTask(job=job), *(MiddleTask(job=job, candidate=i) for i in range(2)), LastTask(job=job)]

    def finish(self, job: Job) -> list[StageTask]:
        """Run what is not complete."""
        tasks = self.tasks(job)
        for task in tasks:
            if not task.complete():
                task.run()
        return tasks


@pytest.fixture
def tiny(tmp_path: Path) -> TinyPipeline:
    return TinyPipeline(tmp_path / "workdir", [])


@pytest.fixture
def number_source() -> Callable[..., NumberSource]:
    return NumberSource
