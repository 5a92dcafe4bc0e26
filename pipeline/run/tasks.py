"""The tasks, in the order in which data flows.

A stage is a package. Its `__init__` holds its VERSION and imports nothing, so that keys cost no time. Its function is
in `stage.py`, which only the worker process imports, since torch takes seconds to import.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.run.isolated_luigi import luigi
from pipeline.run.plugins import own_weights
from pipeline.run.task import Given, Job, StageTask
from schemas.alignment import Alignment
from schemas.assessment import Assessment
from schemas.config import ProjectionConfig
from schemas.flow import Flow
from schemas.kinematic import CanonicalChoice, KinematicModel
from schemas.metrics import Metrics
from schemas.model_file import Result
from schemas.relaxed import RelaxedModel
from schemas.report import Report
from schemas.robot import Robot
from schemas.sequence import IngestedSequence, PointSequence
from stages import (
    alignment,
    assessment,
    canonical_frame,
    evaluation,
    export,
    final_fit,
    flow,
    ingest,
    merging,
    projection,
    relaxed_fit,
    report,
    result,
)

Inputs = Mapping[str, Any]


class IngestTask(StageTask):
    stage, version, schema = "ingest", ingest.VERSION, IngestedSequence

    def upstream_keys(self) -> dict[str, str]:
        return {"source": self.job.source_digest}

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> IngestedSequence:
        from stages.ingest.stage import compute_ingest

        return compute_ingest(given.source, given.settings.ingest, given.rng, given.progress)


class AlignmentTask(StageTask):
    stage, version, schema = "alignment", alignment.VERSION, Alignment

    def requires(self) -> dict[str, StageTask]:
        return {"ingest": IngestTask(job=self.job)}

    def check(self, inputs: Inputs) -> None:
        from stages.canonical_frame.candidates import candidate_frames

        candidate_frames(inputs["ingest"].sequence.point_counts.tolist(), self.job.config.canonical_frame)

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> Alignment:
        from stages.alignment.stage import compute_alignment

        return compute_alignment(inputs["ingest"].sequence, given.settings.alignment, given.progress)


class CommonTask(StageTask):
    """A stage that works in common coordinates, where the object's largest body stands still."""

    def requires(self) -> dict[str, StageTask]:
        return {"ingest": IngestTask(job=self.job), "alignment": AlignmentTask(job=self.job)}


def common_sequence(inputs: Inputs) -> PointSequence:
    """The sequence in common coordinates, for a CommonTask."""
    from stages.alignment.coordinates import in_common_coordinates

    return in_common_coordinates(inputs["ingest"].sequence, inputs["alignment"])


def projection_settings(inputs: Inputs, given: Given) -> ProjectionConfig:
    """The settings of projection. In upright scans of their own coordinates, what stands on the ground is the root.

    There nothing is known to stand still.
    """
    config = given.settings.projection
    alignment = inputs["alignment"]
    on_ground = alignment.own_frames and alignment.upright and config.root == "still"
    return config.model_copy(update={"root": "ground"}) if on_ground else config


class FlowTask(CommonTask):
    stage, version, schema = "flow", flow.VERSION, Flow

    def function(self) -> str:
        return self.job.config.flow.estimator

    def upstream_keys(self) -> dict[str, str]:
        return super().upstream_keys() | own_weights(self.job.config.flow.network.weights)

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> Flow:
        from stages.flow.stage import compute_flow

        return compute_flow(common_sequence(inputs), given.settings.flow, given.rng, given.progress)


class CandidateTask(CommonTask):
    """A stage that runs once for each candidate canonical frame.

    A candidate's frame depends on the sequence's length, which is known only after ingest. Its index among the
    candidates is known before, so keys use the index.
    """

    candidate = luigi.IntParameter()

    def parameters(self) -> dict[str, Any]:
        frames = self.job.config.canonical_frame.frames
        return {"frame": frames[self.candidate]} if frames else {"candidate": self.candidate}


class RelaxedFitTask(CandidateTask):
    stage, version, schema = "relaxed_fit", relaxed_fit.VERSION, RelaxedModel

    def requires(self) -> dict[str, StageTask]:
        if self.candidate >= self.job.config.canonical_frame.fitted(self.job.frame_count):
            return super().requires() | {"relaxed_fit": RelaxedFitTask(job=self.job, candidate=0)}
        return super().requires() | {"flow": FlowTask(job=self.job)}

    def function(self) -> str:
        return self.job.config.relaxed_fit.solver

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> RelaxedModel:
        from stages.canonical_frame.candidates import candidate_frame
        from stages.relaxed_fit.carry_over import carry_over
        from stages.relaxed_fit.stage import compute_relaxed_fit

        sequence = common_sequence(inputs)
        frame = candidate_frame(sequence.point_counts.tolist(), **given.parameters)
        if "relaxed_fit" in inputs:
            return carry_over(inputs["relaxed_fit"], sequence, frame)
        return compute_relaxed_fit(
            sequence, inputs["flow"], frame, given.settings.relaxed_fit, given.rng, given.progress
        )


class ProjectionTask(CandidateTask):
    stage, version, schema = "projection", projection.VERSION, KinematicModel

    def requires(self) -> dict[str, StageTask]:
        return super().requires() | {"relaxed_fit": RelaxedFitTask(job=self.job, candidate=self.candidate)}

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> KinematicModel:
        from stages.projection.stage import compute_projection

        return compute_projection(inputs["relaxed_fit"], common_sequence(inputs), projection_settings(inputs, given))


class MergingTask(CandidateTask):
    stage, version, schema = "merging", merging.VERSION, KinematicModel
    also = ("projection",)

    def requires(self) -> dict[str, StageTask]:
        return super().requires() | {"projection": ProjectionTask(job=self.job, candidate=self.candidate)}

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> KinematicModel:
        from stages.merging.stage import compute_merging

        settings, sequence = given.settings, common_sequence(inputs)
        return compute_merging(inputs["projection"], sequence, settings.merging, projection_settings(inputs, given))


class FinalFitTask(CandidateTask):
    stage, version, schema = "final_fit", final_fit.VERSION, KinematicModel
    also = ("projection",)

    def requires(self) -> dict[str, StageTask]:
        job = self.job
        return super().requires() | {
            "flow": FlowTask(job=job),
            "merging": MergingTask(job=job, candidate=self.candidate),
        }

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> KinematicModel:
        from stages.final_fit.stage import compute_final_fit, suited_to

        model, sequence = inputs["merging"], common_sequence(inputs)
        settings = given.settings
        config = suited_to(settings.final_fit, sequence, inputs["alignment"].own_frames)
        kinds, middle_root = settings.projection.kinds, settings.projection.root == "middle"
        return compute_final_fit(model, sequence, inputs["flow"], config, given.rng, given.progress, kinds, middle_root)


class CanonicalFrameTask(CommonTask):
    stage, version, schema = "canonical_frame", canonical_frame.VERSION, CanonicalChoice
    also = ("final_fit",)

    def requires(self) -> dict[str, StageTask]:
        tried = self.job.config.canonical_frame.tried(self.job.frame_count)
        tasks = [FinalFitTask(job=self.job, candidate=rank) for rank in range(tried)]
        return super().requires() | {task.label: task for task in tasks}

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> CanonicalChoice:
        from stages.alignment.coordinates import in_own_coordinates
        from stages.canonical_frame.stage import compute_canonical_frame

        models = [model for name, model in inputs.items() if name not in ("ingest", "alignment")]
        settings, sequence = given.settings, common_sequence(inputs)
        choice = compute_canonical_frame(models, sequence, settings.canonical_frame.by, settings.final_fit)
        return choice.replace(model=in_own_coordinates(choice.model, inputs["alignment"]))


class AssessmentTask(StageTask):
    stage, version, schema = "assessment", assessment.VERSION, Assessment
    also = ("final_fit",)

    def requires(self) -> dict[str, StageTask]:
        return {"ingest": IngestTask(job=self.job), "canonical_frame": CanonicalFrameTask(job=self.job)}

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> Assessment:
        from stages.assessment.stage import compute_assessment

        return compute_assessment(inputs["canonical_frame"].model, inputs["ingest"].sequence, given.settings.final_fit)


class ResultTask(StageTask):
    stage, version, schema = "result", result.VERSION, Result

    def requires(self) -> dict[str, StageTask]:
        return {
            "ingest": IngestTask(job=self.job),
            "canonical_frame": CanonicalFrameTask(job=self.job),
            "assessment": AssessmentTask(job=self.job),
        }

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> Result:
        from stages.result.stage import compute_result

        return compute_result(inputs["canonical_frame"].model, inputs["ingest"].sequence, inputs["assessment"])

    @staticmethod
    def files(output: Result, inputs: Inputs, given: Given) -> dict[str, bytes]:
        from stages.result.stage import result_files

        return result_files(output)


class ExportTask(StageTask):
    stage, version, schema = "export", export.VERSION, Robot

    def requires(self) -> dict[str, StageTask]:
        return {"ingest": IngestTask(job=self.job), "result": ResultTask(job=self.job)}

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> Robot:
        from stages.export.stage import compute_export

        frames, colours = inputs["ingest"].sequence.in_input()
        return compute_export(inputs["result"], frames, given.settings.export, given.source.name, colours)

    @staticmethod
    def files(output: Robot, inputs: Inputs, given: Given) -> dict[str, bytes]:
        from stages.export.stage import mjcf_files, urdf_files

        return urdf_files(output) | mjcf_files(output)


class EvaluationTask(StageTask):
    stage, version, schema = "evaluation", evaluation.VERSION, Metrics

    def requires(self) -> dict[str, StageTask]:
        return {
            "ingest": IngestTask(job=self.job),
            "canonical_frame": CanonicalFrameTask(job=self.job),
            "assessment": AssessmentTask(job=self.job),
        }

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> Metrics:
        from stages.evaluation.stage import compute_evaluation

        model, settings = inputs["canonical_frame"].model, given.settings.evaluation
        return compute_evaluation(model, inputs["ingest"], settings, given.rng, inputs["assessment"])


class ReportTask(StageTask):
    stage, version, schema = "report", report.VERSION, Report

    def requires(self) -> dict[str, StageTask]:
        return {
            "ingest": IngestTask(job=self.job),
            "result": ResultTask(job=self.job),
            "export": ExportTask(job=self.job),
            "evaluation": EvaluationTask(job=self.job),
        }

    @staticmethod
    def compute(inputs: Inputs, given: Given) -> Report:
        from stages.report.stage import compute_report

        return compute_report(inputs["result"], inputs["ingest"].sequence)

    @staticmethod
    def files(output: Report, inputs: Inputs, given: Given) -> dict[str, bytes]:
        from stages.report.stage import report_files

        name, robot, metrics = given.source.name, inputs["export"], inputs["evaluation"]
        return report_files(name, inputs["result"], inputs["ingest"], output, robot, metrics)


TASKS: tuple[type[StageTask], ...] = (
    IngestTask,
    AlignmentTask,
    FlowTask,
    RelaxedFitTask,
    ProjectionTask,
    MergingTask,
    FinalFitTask,
    CanonicalFrameTask,
    AssessmentTask,
    ResultTask,
    ExportTask,
    EvaluationTask,
    ReportTask,
)
STAGES = tuple(task.stage for task in TASKS)


FINAL: tuple[type[StageTask], ...] = (ResultTask, ExportTask, EvaluationTask, ReportTask)


def final_tasks(job: Job) -> list[StageTask]:
    """The last tasks of a sequence."""
    return [task(job=job) for task in FINAL]
