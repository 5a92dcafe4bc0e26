"""The evaluation of a whole data set: the metrics of every sequence, their means, and what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Field

from schemas.artifact import Schema
from schemas.metrics import Metrics
from schemas.names import Name

MissingState = Literal["failed", "corrupt", "unreadable", "stale", "missing", "unavailable"]
Level = Literal["robot", "type", "split", "all"]
Verdict = Literal["better", "worse", "same"]


@dataclass(frozen=True)
class Measure:
    """How a metric is shown, and which direction is better. Means of whole numbers have one decimal."""

    title: str
    unit: str = ""
    decimals: int = 3
    better: Literal["higher", "lower"] | None = None


class Figures(Schema):
    """The metrics of one sequence, or the means over several. None marks an unknown value.

    Means over joints weigh every matched joint equally, whichever sequence it belongs to.
    """

    parts_found: Annotated[float | None, Measure("parts", decimals=1)] = None
    parts_true: Annotated[float | None, Measure("true parts", decimals=1)] = None
    parts_off: Annotated[float | None, Measure("parts off", decimals=1, better="lower")] = Field(
        default=None, description="|found - true|"
    )
    oversplit: Annotated[float | None, Measure("> 2 x parts", decimals=2, better="lower")] = Field(
        default=None, description="share of the sequences with more than twice the true number of parts"
    )
    flagged: Annotated[float | None, Measure("flagged", decimals=2)] = Field(
        default=None, description="share of the models whose verdict is not good"
    )
    ari: Annotated[float | None, Measure("ARI", better="higher")] = None
    told_share: Annotated[float | None, Measure("told")] = Field(
        default=None, description="share of observable points, whose part the motion determines"
    )
    ari_told: Annotated[float | None, Measure("ARI told", better="higher")] = Field(
        default=None, description="over observable points"
    )
    ri: Annotated[float | None, Measure("RI", better="higher")] = None
    tree_edit_distance: Annotated[float | None, Measure("TED", decimals=1, better="lower")] = None
    recon_cm: Annotated[float | None, Measure("recon", "cm", better="lower")] = None
    recon_percent: Annotated[float | None, Measure("recon", "%", better="lower")] = None
    recon_of_motion_percent: Annotated[float | None, Measure("recon / motion", "%", 2, "lower")] = Field(
        default=None, description="% of the mean true motion from the canonical frame"
    )
    placement_percent: Annotated[float | None, Measure("placement", "%", better="lower")] = Field(
        default=None, description="recon with the motion of the whole, where each frame has coordinates of its own"
    )
    epe_cm: Annotated[float | None, Measure("EPE", "cm", better="lower")] = None
    epe_percent: Annotated[float | None, Measure("EPE", "%", better="lower")] = None
    epe_of_flow_percent: Annotated[float | None, Measure("EPE / flow", "%", 2, "lower")] = Field(
        default=None, description="% of the mean true flow"
    )
    acc5: Annotated[float | None, Measure("acc5", better="higher")] = None
    acc10: Annotated[float | None, Measure("acc10", better="higher")] = None
    reanimation_cm: Annotated[float | None, Measure("reanim.", "cm", better="lower")] = None
    reanimation_percent: Annotated[float | None, Measure("reanim.", "%", better="lower")] = None
    chamfer_percent: Annotated[float | None, Measure("Chamfer", "%", better="lower")] = None
    joints_found: Annotated[float | None, Measure("joints", decimals=1, better="higher")] = Field(
        default=None, description="true joints that a predicted joint was matched to"
    )
    joints_true: Annotated[float | None, Measure("true joints", decimals=1)] = None
    moving_joints_found: Annotated[float | None, Measure("moving found", better="higher")] = Field(
        default=None, description="share of the true joints with a way of more than three spacings that were matched"
    )
    axis_angle_deg: Annotated[float | None, Measure("axis angle", "deg", 2, "lower")] = Field(
        default=None, description="median over the matched joints"
    )
    axis_angle_mean_deg: Annotated[float | None, Measure("mean axis angle", "deg", 2, "lower")] = Field(
        default=None, description="mean over the matched joints"
    )
    axis_distance_percent: Annotated[float | None, Measure("axis dist.", "%", 2, "lower")] = Field(
        default=None, description="median over the matched revolute joints, % of the diagonal"
    )
    ball_centre_percent: Annotated[float | None, Measure("ball centres", "%", 2, "lower")] = Field(
        default=None, description="mean distance over the matched ball joints, % of the diagonal"
    )
    joint_type_accuracy: Annotated[float | None, Measure("joint types", better="higher")] = Field(
        default=None, description="share of the matched joints whose type is right"
    )
    within_one: Annotated[float | None, Measure("in 1 spread", decimals=2)] = Field(
        default=None,
        description="share of the matched joints' directions and places that are as near to the true ones as their "
        "spread; 0.68 is meant",
    )
    within_two: Annotated[float | None, Measure("in 2 spreads", decimals=2)] = Field(
        default=None, description="the same within two spreads; 0.95 is meant"
    )
    confidence_auc: Annotated[float | None, Measure("conf. AUC", better="higher")] = Field(
        default=None,
        description="of groups only: area under the ROC curve of their predicted joints' confidence in being right",
    )
    seconds: Annotated[float | None, Measure("time", "s", 0, "lower")] = Field(
        default=None, description="of all stages"
    )
    peak_memory_mib: Annotated[float | None, Measure("memory", "MiB", 0, "lower")] = Field(
        default=None, description="of the stage with the most"
    )


MEASURES: dict[str, Measure] = {
    name: entry
    for name, field in Figures.model_fields.items()
    for entry in field.metadata
    if isinstance(entry, Measure)
}


class StageCost(Schema):
    """The time and memory of a stage, all candidates together, for one sequence or as the mean of several."""

    seconds: float
    peak_memory_mib: float | None


class SequenceScore(Schema):
    """One evaluated sequence. `robot`, `type` and `split` are None if the data set does not define them."""

    sequence: Name
    robot: str | None = None
    type: str | None = None
    split: str | None = None
    metrics: Metrics
    figures: Figures
    costs: dict[str, StageCost] = Field(description="by stage")
    result: str | None = Field(description="folder of the model's artifact, from the working directory")
    report: str | None = Field(default=None, description="folder of the report's artifact, from the working directory")


class MissingScore(Schema):
    """A sequence without an evaluation, and why."""

    sequence: Name
    state: MissingState
    message: str
    log: str | None = None


class GroupScore(Schema):
    """Means over the sequences of one robot, type or split, or over all."""

    level: Level
    name: str
    sequences: int = Field(ge=1)
    figures: Figures
    costs: dict[str, StageCost]


class Scores(Schema):
    """The content of `evaluation.json`: everything that the tables show."""

    format: Literal["rearticulate/evaluation"] = "rearticulate/evaluation"
    version: Literal[1] = 1
    dataset: str
    created: datetime
    config: dict[str, Any] = Field(description="the resolved configuration that the artifacts were made with")
    split: str | None = Field(default=None, description="where only the sequences of one split were asked for")
    sequences: tuple[SequenceScore, ...]
    missing: tuple[MissingScore, ...]
    groups: tuple[GroupScore, ...]


class Difference(Schema):
    """One metric, before and after."""

    before: float
    after: float
    verdict: Verdict | None = Field(description="None where no direction is better")

    @property
    def change(self) -> float:
        return self.after - self.before


class ComparedFigures(Schema):
    """The differences of one sequence or of the means, for the metrics that both sides have."""

    name: str
    differences: dict[str, Difference]


class Comparison(Schema):
    """The difference of two evaluations. Means are over the sequences that both have."""

    before: str = Field(description="where the earlier evaluation was read")
    settings: tuple[str, ...] = Field(description="the settings that differ, as `name: before -> after`")
    sequences: tuple[ComparedFigures, ...]
    mean: ComparedFigures | None = Field(description="None where no sequence is in both")
    only_before: tuple[str, ...]
    only_after: tuple[str, ...]
