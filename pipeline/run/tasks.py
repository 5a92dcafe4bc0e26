"""The tasks, in the order in which data flows. Stages are imported where they run, in a worker process."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.run.isolated_luigi import luigi
from pipeline.run.plugins import own_weights
from pipeline.run.task import Job, StageTask
from schemas.flow import Flow
from schemas.kinematic import CanonicalChoice, KinematicModel
from schemas.metrics import Metrics
from schemas.model_file import Result
from schemas.relaxed import RelaxedModel
from schemas.report import Report
from schemas.robot import Robot
from schemas.sequence import IngestedSequence
from stages.support.progress import Progress

Inputs = Mapping[str, Any]


class IngestTask(StageTask):
    stage, version, schema = "ingest", 1, IngestedSequence

    def upstream_keys(self) -> dict[str, str]:
        return {"source": self.job.source_digest}

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> IngestedSequence:
        from stages.ingest import ingest

        return ingest(self.job.source, self.job.config.ingest, rng, progress)


class FlowTask(StageTask):
    stage, version, schema = "flow", 1, Flow

    def requires(self) -> dict[str, StageTask]:
        return {"ingest": IngestTask(job=self.job)}

    def function(self) -> str:
        return self.job.config.flow.estimator

    def upstream_keys(self) -> dict[str, str]:
        return super().upstream_keys() | own_weights(self.job.config.flow.network.weights)

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> Flow:
        from stages.canonical_frame import candidate_frames
        from stages.flow import estimate_flow

        config, sequence = self.job.config, inputs["ingest"].sequence
        candidate_frames(
            sequence.point_counts.tolist(), config.canonical_frame
        )  # what it refuses is told before the work
        return estimate_flow(sequence, config.flow, rng, progress)


class CandidateTask(StageTask):
    """A stage that runs once for each candidate canonical frame.

    Which frame a candidate is depends on the sequence's length, which is known only after ingest; its
    place among the candidates is known before, so that keys are too.
    """

    candidate = luigi.IntParameter()

    def parameters(self) -> dict[str, Any]:
        frames = self.job.config.canonical_frame.frames
        return {"frame": frames[self.candidate]} if frames else {"candidate": self.candidate}


class RelaxedFitTask(CandidateTask):
    stage, version, schema = "relaxed_fit", 5, RelaxedModel

    def requires(self) -> dict[str, StageTask]:
        ingest = IngestTask(job=self.job)
        if self.candidate >= self.job.config.canonical_frame.fits:
            return {"ingest": ingest, "relaxed_fit": RelaxedFitTask(job=self.job, candidate=0)}
        return {"ingest": ingest, "flow": FlowTask(job=self.job)}

    def function(self) -> str:
        return self.job.config.relaxed_fit.solver

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> RelaxedModel:
        from stages.canonical_frame import candidate_frames
        from stages.relaxed_fit import fit_relaxed
        from stages.relaxed_fit.carry_over import carry_over

        config, sequence = self.job.config, inputs["ingest"].sequence
        frame = candidate_frames(sequence.point_counts.tolist(), config.canonical_frame)[self.candidate]
        if "relaxed_fit" in inputs:
            return carry_over(inputs["relaxed_fit"], sequence, frame)
        return fit_relaxed(sequence, inputs["flow"], frame, config.relaxed_fit, rng, progress)


class ProjectionTask(CandidateTask):
    stage, version, schema = "projection", 3, KinematicModel

    def requires(self) -> dict[str, StageTask]:
        relaxed = RelaxedFitTask(job=self.job, candidate=self.candidate)
        return {"ingest": IngestTask(job=self.job), "relaxed_fit": relaxed}

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> KinematicModel:
        from stages.projection import project

        return project(inputs["relaxed_fit"], inputs["ingest"].sequence, self.job.config.projection)


class MergingTask(CandidateTask):
    stage, version, schema = "merging", 3, KinematicModel

    def requires(self) -> dict[str, StageTask]:
        projection = ProjectionTask(job=self.job, candidate=self.candidate)
        return {"ingest": IngestTask(job=self.job), "projection": projection}

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> KinematicModel:
        from stages.merging import merge

        config = self.job.config  # the settings of projection are in the key of what is read
        return merge(inputs["projection"], inputs["ingest"].sequence, config.merging, config.projection)


class FinalFitTask(CandidateTask):
    stage, version, schema = "final_fit", 10, KinematicModel

    def requires(self) -> dict[str, StageTask]:
        job = self.job
        return {
            "ingest": IngestTask(job=job),
            "flow": FlowTask(job=job),
            "merging": MergingTask(job=job, candidate=self.candidate),
        }

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> KinematicModel:
        from stages.final_fit import fit_final

        model, sequence = inputs["merging"], inputs["ingest"].sequence
        return fit_final(model, sequence, inputs["flow"], self.job.config.final_fit, rng, progress)


class CanonicalFrameTask(StageTask):
    stage, version, schema = "canonical_frame", 4, CanonicalChoice

    def requires(self) -> dict[str, StageTask]:
        config = self.job.config.canonical_frame
        tasks = [FinalFitTask(job=self.job, candidate=rank) for rank in range(len(config.frames) or config.candidates)]
        return {"ingest": IngestTask(job=self.job)} | {task.label: task for task in tasks}

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> CanonicalChoice:
        from stages.canonical_frame import choose

        models = [model for name, model in inputs.items() if name != "ingest"]
        config = self.job.config
        return choose(models, inputs["ingest"].sequence, config.canonical_frame.by, config.final_fit)


class ResultTask(StageTask):
    stage, version, schema = "result", 3, Result

    def requires(self) -> dict[str, StageTask]:
        return {"ingest": IngestTask(job=self.job), "canonical_frame": CanonicalFrameTask(job=self.job)}

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> Result:
        from stages.result import to_result

        return to_result(inputs["canonical_frame"].model, inputs["ingest"].sequence)

    def files(self, output: Result, inputs: Inputs) -> dict[str, bytes]:
        from stages.result import result_files

        return result_files(output)


class ExportTask(StageTask):
    stage, version, schema = "export", 3, Robot

    def requires(self) -> dict[str, StageTask]:
        return {"ingest": IngestTask(job=self.job), "result": ResultTask(job=self.job)}

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> Robot:
        from stages.export import describe

        sequence = inputs["ingest"].sequence
        frames = [sequence.to_input(frame) for frame in sequence.frames()]
        return describe(inputs["result"], frames, self.job.config.export, self.job.source.name)

    def files(self, output: Robot, inputs: Inputs) -> dict[str, bytes]:
        from stages.export import mjcf_files, urdf_files

        return urdf_files(output) | mjcf_files(output)


class EvaluationTask(StageTask):
    stage, version, schema = "evaluation", 3, Metrics

    def requires(self) -> dict[str, StageTask]:
        return {"ingest": IngestTask(job=self.job), "canonical_frame": CanonicalFrameTask(job=self.job)}

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> Metrics:
        from stages.evaluation import evaluate

        return evaluate(inputs["canonical_frame"].model, inputs["ingest"], self.job.config.evaluation, rng)


class ReportTask(StageTask):
    stage, version, schema = "report", 2, Report

    def requires(self) -> dict[str, StageTask]:
        return {
            "ingest": IngestTask(job=self.job),
            "result": ResultTask(job=self.job),
            "export": ExportTask(job=self.job),
            "evaluation": EvaluationTask(job=self.job),
        }

    def compute(self, inputs: Inputs, rng: np.random.Generator, progress: Progress) -> Report:
        from stages.report import measure

        return measure(inputs["result"], inputs["ingest"].sequence)

    def files(self, output: Report, inputs: Inputs) -> dict[str, bytes]:
        from stages.report import report_files

        name, robot, metrics = self.job.source.name, inputs["export"], inputs["evaluation"]
        return report_files(name, inputs["result"], inputs["ingest"], output, robot, metrics)


TASKS: tuple[type[StageTask], ...] = (
    IngestTask,
    FlowTask,
    RelaxedFitTask,
    ProjectionTask,
    MergingTask,
    FinalFitTask,
    CanonicalFrameTask,
    ResultTask,
    ExportTask,
    EvaluationTask,
    ReportTask,
)
STAGES = tuple(task.stage for task in TASKS)


FINAL: tuple[type[StageTask], ...] = (ResultTask, ExportTask, EvaluationTask, ReportTask)


def final_tasks(job: Job) -> list[StageTask]:
    """What a sequence ends in."""
    return [task(job=job) for task in FINAL]
