"""The artifact of the evaluation stage (A.9)."""

from __future__ import annotations

from pydantic import Field

from schemas.artifact import Artifact, Schema
from schemas.assessment import Trust


class JointMetrics(Schema):
    """One true joint and the predicted joint between the same two parts, if there is one."""

    name: str
    true_type: str
    predicted_type: str | None = Field(description="None: no predicted joint links these two parts")
    axis_angle_deg: float | None = None
    axis_distance_percent: float | None = Field(default=None, description="% of the diagonal; None for prismatic")
    direction_spread_deg: float | None = Field(default=None, description="what the model states for the axis angle")
    place_percent: float | None = Field(
        default=None,
        description="distance of the joint's point from the true axis or centre, % of the diagonal; None for prismatic",
    )
    place_spread_percent: float | None = Field(default=None, description="what the model states for that distance")
    ball_centre_percent: float | None = Field(
        default=None, description="between the centres of two ball joints, % of the diagonal; None for other types"
    )
    state_error: float | None = Field(
        default=None, description="mean |state error|, radians (revolute) or % of the diagonal (prismatic)"
    )
    travel_spacings: float | None = Field(
        default=None,
        description="longest way of the child's points between two frames by this joint alone, in spacings",
    )
    confidence: float | None = Field(default=None, description="the least of the predicted joint's confidences")


class JointVerdict(Schema):
    """The confidence of a predicted joint (the least of its three), and whether the joint is right."""

    confidence: float = Field(ge=0, le=1)
    right: bool = Field(description="it links two parts that were matched to those of one true joint")


class Metrics(Artifact):
    """The metrics of one sequence. Lengths are in the input's units and in % of the object's diagonal.

    Metrics that need ground truth are None without it. The Chamfer distance needs none.
    """

    units: str
    diagonal: float
    canonical_frame: int
    parts_found: int
    chamfer_percent: float = Field(description="mean both-sided distance between model and frames")
    trust: Trust | None = Field(default=None, description="the verdict on the model, which needs no ground truth")
    parts_true: int | None = Field(default=None, description="true parts that are seen")
    unseen_parts: tuple[str, ...] = Field(default=(), description="true parts that no frame shows; they do not count")
    ari: float | None = None
    ri: float | None = None
    told_share: float | None = Field(
        default=None,
        description="share of observable points: only their own part can move them as the frames show",
    )
    ari_told: float | None = Field(default=None, description="ARI over observable points; None if there are none")
    untold_parts: tuple[str, ...] = Field(default=(), description="true parts with hardly any observable point")
    tree_edit_distance: int | None = None
    recon: float | None = None
    recon_percent: float | None = None
    recon_of_motion_percent: float | None = Field(
        default=None, description="recon in % of the points' mean true motion from the canonical frame"
    )
    placement_percent: float | None = Field(
        default=None,
        description="recon in each frame's own coordinates, with the motion of the whole; None where they share them",
    )
    epe: float | None = None
    epe_percent: float | None = None
    epe_of_flow_percent: float | None = Field(default=None, description="EPE in % of the mean length of the true flow")
    acc5: float | None = None
    acc10: float | None = None
    reanimation: float | None = None
    reanimation_percent: float | None = None
    joint_type_accuracy: float | None = None
    joints: tuple[JointMetrics, ...] = ()
    verdicts: tuple[JointVerdict, ...] = Field(
        default=(), description="of every predicted joint that has a confidence, if the true joints are known"
    )
