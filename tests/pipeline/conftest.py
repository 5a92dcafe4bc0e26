"""A pipeline of three tiny stages that stands in for the real one, and finished artifacts of two robots."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from jaxtyping import Float64

from pipeline.configuration.presets import load_config
from pipeline.run.isolated_luigi import luigi
from pipeline.run.plan import plan
from pipeline.run.protocol import Event, Request
from pipeline.run.task import Job, StageTask, upstream_first
from pipeline.run.tasks import final_tasks
from pipeline.store import artifacts
from schemas.artifact import Artifact, Unit
from schemas.config import PipelineConfig
from schemas.errors import InputError, UnavailableError
from schemas.manifest import Provenance
from stages.ingest.sources import RoboartSource
from stages.result.stage import result_files


class Numbers(Artifact):
    values: Annotated[Float64[np.ndarray, "rows"], Unit("1")]


@dataclass(frozen=True)
class NumberSource:
    """Stands in for a source of sequences; `refuses` makes it bad input."""

    name: str = "box"
    content: str = "content"
    refuses: str = ""

    def frame_count(self, config) -> None:
        return None

    def digest(self) -> str:
        if self.refuses == "digest":
            raise InputError(f"{self.name}: cannot be read")
        return self.content


class FirstTask(StageTask):
    stage, version, schema = "ingest", 1, Numbers

    def upstream_keys(self):
        return {"source": self.job.source_digest}

    @staticmethod
    def compute(inputs, given):
        print("a word on standard output")
        logging.getLogger("rearticulate.test").warning("three points were dropped")
        if given.source.refuses == "load":
            raise InputError("frame.ply: found\nnothing")
        for step in range(100):
            given.progress(step, 100, 1.0 / (step + 1))
        return Numbers(values=given.rng.normal(size=4))


class MiddleTask(StageTask):
    stage, version, schema = "merging", 1, Numbers
    candidate = luigi.IntParameter()

    def parameters(self):
        return {"candidate": self.candidate}

    def requires(self):
        return {"first": FirstTask(job=self.job)}

    @staticmethod
    def compute(inputs, given):
        return Numbers(values=inputs["first"].values + given.rng.normal(size=4))


class LastTask(StageTask):
    stage, version, schema = "final_fit", 1, Numbers

    def requires(self):
        return {f"middle {i}": MiddleTask(job=self.job, candidate=i) for i in range(2)}

    @staticmethod
    def compute(inputs, given):
        return Numbers(values=np.concatenate([inputs["middle 0"].values, inputs["middle 1"].values]))

    @staticmethod
    def files(output, inputs, given):
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


@dataclass(frozen=True)
class EvaluatedRobots:
    """A working directory with finished artifacts of some robots, as a run leaves them; nothing was computed."""

    workdir: Path
    samples: dict[str, Artifact]
    config: PipelineConfig
    lacked: set[str] = field(default_factory=set)  # robots without a description

    def request(self, *sequences: str) -> Request:
        return Request(
            dataset="roboart", workdir=self.workdir, config=self.config, sequences=sequences or ("bolt", "ur5")
        )

    def job(self, robot: str) -> Job:
        [job] = plan(self.request(robot))
        return job

    def finish(self, robot: str, **figures: float) -> None:
        """Publish every artifact of a robot: each stage took 3.5 seconds and 100 MiB, a later one of it more."""
        made = {
            "ingest": self.samples["ingested"],
            "result": self.samples["result"].replace(
                canonical_points=np.random.default_rng(0).normal(size=(4, 3)).astype(np.float32)
            ),
            "evaluation": self.samples["metrics"].replace(parts_true=4, **figures),
            "report": self.samples["report"],
        }
        files = {
            "report": {"report.html": f"<p>{robot}".encode(), "report.png": b"\x89PNG"},
            "result": result_files(made["result"]),
        }
        for task in upstream_first(final_tasks(self.job(robot))):
            provenance = Provenance(
                stage=task.stage,
                version=task.version,
                dataset="roboart",
                sequence=robot,
                key=task.key,
                parameters=task.parameters(),
                config={},
                upstream=task.upstream_keys(),
                seed=0,
                created=datetime.now(UTC),
                seconds={"read": 0.5, "compute": 3.0},
                peak_memory_mib=100 + task.parameters().get("candidate", 0),
                packages={},
            )
            artifact = made.get(task.stage, Numbers(values=np.zeros(1)))
            artifacts.publish(task.directory, artifact, provenance, files.get(task.stage))


@pytest.fixture
def evaluated(tmp_path: Path, samples: dict[str, Artifact], monkeypatch: pytest.MonkeyPatch) -> EvaluatedRobots:
    """Two evaluated robots: bolt with an ARI of 0.9 and ur5 with one of 0.5. No description of theirs is needed."""
    robots = EvaluatedRobots(tmp_path / "workdir", samples, load_config(["roboart"]))

    def digest(source: RoboartSource) -> str:
        if source.thing in robots.lacked:
            raise UnavailableError(f"robot {source.thing!r}: found no URDF, expected one; put one somewhere")
        return source.name

    monkeypatch.setattr(RoboartSource, "digest", digest)
    robots.finish("bolt", ari=0.9, recon=0.005, recon_percent=0.3)
    robots.finish("ur5", ari=0.5)
    return robots


@pytest.fixture
def scan_request(tmp_path: Path) -> Request:
    """One sequence of files, of which nothing was computed."""
    (tmp_path / "data" / "box").mkdir(parents=True)
    np.save(tmp_path / "data" / "box" / "0.npy", np.zeros((40, 3)))
    return Request(dataset="scans", workdir=tmp_path / "workdir", config=load_config(["scans"]), data=tmp_path / "data")
