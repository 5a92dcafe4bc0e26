"""The artifact of ingest: the observed sequence and its ground truth, if known."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from jaxtyping import Bool, Float64, Int64, UInt8
from pydantic import Field, FiniteFloat, model_validator

from schemas.artifact import Artifact, Rigid, Schema, Unit, Within
from schemas.joints import JOINT_KINDS, JointKind, JointType

LengthUnit = Literal["metre", "centimetre", "millimetre", "unknown"]

LENGTH_SYMBOLS: dict[LengthUnit, str] = {
    "metre": "m",
    "centimetre": "cm",
    "millimetre": "mm",
    "unknown": "input units",
}
METRES: dict[LengthUnit, float] = {"metre": 1.0, "centimetre": 0.01, "millimetre": 0.001}
MOST_POINTS = 2**40  # in one frame
NO_PART = -1  # true label of a point that belongs to no part: a stray one, or one of the table below the object


class PointSequence(Artifact):
    """T independently sampled point clouds, in a normalised frame.

    The normalised frame is centred on the object and scaled so that the diagonal of its bounding box is
    one: `p_input = p_normalised * scale + centre`. `points` holds the frames one after the other. Frame t has
    `point_counts[t]` points, in the input's order.
    """

    points: Annotated[Float64[np.ndarray, "all_points 3"], Unit("normalised")]
    point_counts: Annotated[Int64[np.ndarray, "frames"], Unit("count"), Within(1, MOST_POINTS)]
    dropped_counts: Annotated[Int64[np.ndarray, "frames"], Unit("count"), Within(0, MOST_POINTS)] = Field(
        description="points of each input frame that were dropped: NaN, infinite, or a large number at one place"
    )
    colours: Annotated[UInt8[np.ndarray, "all_points 3"] | None, Unit("sRGB")] = Field(
        default=None, description="red, green and blue of each point, if the scans have colours"
    )
    scale: float = Field(
        gt=0, allow_inf_nan=False, description="input units per normalised unit: the object's diagonal"
    )
    centre: tuple[FiniteFloat, FiniteFloat, FiniteFloat] = Field(
        description="input coordinates of the normalised origin"
    )
    units: LengthUnit = Field(description="the input's unit of length")
    frame_names: tuple[str, ...] = Field(description="where each frame came from, for messages")
    viewpoints: Annotated[Float64[np.ndarray, "frames cameras 3"] | None, Unit("normalised")] = Field(
        default=None,
        description="positions of the cameras that saw each frame, in that frame's coordinates; None: unknown",
    )

    cleaned: dict[str, tuple[int, ...]] = Field(
        default_factory=dict, description="points of each input frame that each step of the clean-up took"
    )
    remarks: tuple[str, ...] = Field(default=(), description="remarks on the input for the user, one line each")

    @model_validator(mode="after")
    def _check_counts(self) -> Self:
        if int(self.point_counts.sum()) != len(self.points):
            raise ValueError(
                f"PointSequence.point_counts: found a sum of {int(self.point_counts.sum())} with "
                f"{len(self.points)} points, expected positive counts that add up to them"
            )
        if len(self.frame_names) != len(self.point_counts):
            raise ValueError(
                f"PointSequence.frame_names: found {len(self.frame_names)}, "
                f"expected one for each of the {len(self.point_counts)} frames"
            )
        return self

    @property
    def frame_count(self) -> int:
        return len(self.point_counts)

    def frames(self) -> list[Float64[np.ndarray, "points 3"]]:
        """The frames as views into `points`."""
        return self.by_frame(self.points)

    def by_frame(self, values: np.ndarray) -> list[np.ndarray]:
        """Split values of all points, in the order of `points`, into one view per frame."""
        return np.split(values, np.cumsum(self.point_counts)[:-1])

    def in_input(
        self,
    ) -> tuple[list[Float64[np.ndarray, "points 3"]], list[UInt8[np.ndarray, "points 3"]] | None]:
        """The frames in the input's coordinates and units, and the colours of their points if known."""
        colours = None if self.colours is None else self.by_frame(self.colours)
        return [self.to_input(frame) for frame in self.frames()], colours

    def to_input(self, p_normalised: Float64[np.ndarray, "*batch 3"]) -> Float64[np.ndarray, "*batch 3"]:
        """Convert normalised coordinates to the input's coordinates and units."""
        return p_normalised * self.scale + np.asarray(self.centre)


class TrueJoint(Schema):
    """One joint of the ground truth, in normalised coordinates of frame 0. `point` is a ball joint's centre."""

    name: str
    parent: int
    child: int
    type: JointType
    axis: tuple[float, float, float] = Field(description="unit direction of the axis in frame 0; any of a ball joint")
    point: tuple[float, float, float] = Field(description="a point on the axis in frame 0")
    states: tuple[float, ...] = Field(
        description="joint position in each frame minus the one in frame 0: "
        "radians (revolute) or normalised lengths (prismatic); of a ball joint the angle between the two"
    )

    @property
    def kind(self) -> JointKind:
        return JOINT_KINDS[self.type]


class GroundTruth(Artifact):
    """True parts, motions and tree of a sequence.

    The label of a point that belongs to no part is `NO_PART`: no metric counts it. `parent[p]` is -1 for the root. If
    the tree is unknown, it is -1 for every part.
    """

    labels: Annotated[Int64[np.ndarray, "all_points"], Unit("index"), Within(NO_PART, "parts")]
    Ts_frame_first: Annotated[Float64[np.ndarray, "frames parts 4 4"], Unit("normalised"), Rigid(0.01)] = Field(
        description="maps a point of part p from its position in frame 0 to that in frame t"
    )
    Ts_novel_first: Annotated[Float64[np.ndarray, "states parts 4 4"], Unit("normalised"), Rigid(0.01)] = Field(
        description="the same for unseen states, for the reanimation metric"
    )
    parent: Annotated[Int64[np.ndarray, "parts"], Unit("index"), Within(-1, "parts")]
    part_names: tuple[str, ...]
    joints: tuple[TrueJoint, ...] = Field(description="empty if the source does not define them")
    own_coordinates: bool = Field(
        default=False, description="each frame has coordinates of its own: the motion of the whole is not the object's"
    )

    @model_validator(mode="after")
    def _check_tree(self) -> Self:
        parts = len(self.parent)
        ancestor = np.arange(parts)
        for _ in range(parts):
            ancestor = np.where(ancestor >= 0, self.parent[ancestor], -1)
        if np.any(ancestor >= 0):
            raise ValueError(f"GroundTruth.parent: found a loop in {self.parent.tolist()}, expected a tree")
        for joint in self.joints:
            if not (0 <= joint.parent < parts and 0 <= joint.child < parts):
                ends = f"{joint.parent} and {joint.child}"
                raise ValueError(f"GroundTruth.joints: {joint.name} links {ends}, expected two of 0..{parts - 1}")
        return self


class TrueSurface(Artifact):
    """A rigid or soft surface with known vertices in every frame, and the places of the observed points on it.

    Point i of `PointSequence.points` was sampled in its own frame at the mean of the vertices `corners[i]`, weighted by
    `weights[i]`, which add up to one.
    """

    vertices: Annotated[Float64[np.ndarray, "frames vertices 3"], Unit("normalised")]
    corners: Annotated[Int64[np.ndarray, "all_points 3"], Unit("index"), Within(0, "vertices")]
    weights: Annotated[Float64[np.ndarray, "all_points 3"], Unit("share"), Within(0, 1)]


class IngestedSequence(Artifact):
    """The artifact of the ingest stage. Only evaluation and pictures read the truth; other stages get `sequence`.

    `truth` holds the parts, if the source knows them. `surface` holds the place of each point in every frame, if rigid
    parts do not determine it.
    """

    sequence: PointSequence
    truth: GroundTruth | None = None
    surface: TrueSurface | None = None

    def true_labels(self, frame: int) -> Int64[np.ndarray, "points"] | None:
        """The true part of each point of a frame (`NO_PART` for none), or None without ground truth."""
        if self.truth is None:
            return None
        return self.sequence.by_frame(self.truth.labels)[frame]

    def of_object(self, frame: int) -> Bool[np.ndarray, "points"]:
        """Which points of a frame belong to a true part; all, where the parts are not known."""
        labels = self.true_labels(frame)
        if labels is None:
            return np.ones(self.sequence.point_counts[frame], dtype=bool)
        return labels != NO_PART

    def on_surface(self, frame: int) -> Float64[np.ndarray, "frames points 3"] | None:
        """True positions in every frame of the points of one frame, from the surface; None without a surface.

        A point keeps its observed offset from the surface.
        """
        if self.surface is None:
            return None
        corners, weights = (self.sequence.by_frame(of)[frame] for of in (self.surface.corners, self.surface.weights))
        p_surface = np.stack([np.einsum("nk,nkd->nd", weights, p[corners]) for p in self.surface.vertices])
        p_true: Float64[np.ndarray, "frames points 3"] = p_surface + (self.sequence.frames()[frame] - p_surface[frame])
        return p_true

    @model_validator(mode="after")
    def _check_surface(self) -> Self:
        if self.surface is None:
            return self
        found = (len(self.surface.corners), len(self.surface.vertices))
        expected = (len(self.sequence.points), self.sequence.frame_count)
        if found != expected:
            raise ValueError(
                f"TrueSurface: found places of {found[0]} points in {found[1]} frames, "
                f"expected {expected[0]} in {expected[1]} as in the sequence"
            )
        return self

    @model_validator(mode="after")
    def _check_truth(self) -> Self:
        if self.truth is None:
            return self
        found = (len(self.truth.labels), len(self.truth.Ts_frame_first))
        expected = (len(self.sequence.points), self.sequence.frame_count)
        if found != expected:
            raise ValueError(
                f"GroundTruth: found {found[0]} labels in {found[1]} frames, "
                f"expected {expected[0]} in {expected[1]} as in the sequence"
            )
        return self
