"""The result's contract: model.json and model.npz, as other programs read them."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float32, Float64, Int64
from pydantic import Field

from schemas.artifact import Artifact, Schema, Unit
from schemas.sequence import JointType, LengthUnit

Vector = tuple[float, float, float]


class ModelPart(Schema):
    id: int
    name: str
    point_count: int


class JointConfidence(Schema):
    """How sure the fit is, from 0 to 1, that both parts are ones of their own, of their link, and of its type."""

    part: float = Field(ge=0, le=1)
    link: float = Field(ge=0, le=1)
    type: float = Field(ge=0, le=1)


class ModelJoint(Schema):
    """One joint; lengths in the input's units, angles in radians, the canonical frame's coordinates."""

    id: int
    name: str
    parent: int
    child: int
    type: JointType
    axis: Vector
    point: Vector
    lower: float
    upper: float
    confidence: JointConfidence | None = None
    states: tuple[float | Vector, ...]


class ModelFile(Schema):
    """model.json. `model.npz` beside it holds canonical_points, labels and T_frame_canonical."""

    format: Literal["rearticulate/model"] = "rearticulate/model"
    version: Literal[1] = 1
    units: LengthUnit
    frames: int = Field(gt=0)
    canonical_frame: int = Field(ge=0)
    root: int = Field(ge=0)
    parts: tuple[ModelPart, ...]
    joints: tuple[ModelJoint, ...]


class Result(Artifact):
    """The artifact of the last stage: what model.json and model.npz hold, in the input's units."""

    model: ModelFile
    canonical_points: Annotated[Float32[np.ndarray, "points 3"], Unit("input")]
    labels: Annotated[Int64[np.ndarray, "points"], Unit("index")]
    T_frame_canonical: Annotated[Float64[np.ndarray, "frames parts 4 4"], Unit("input")]
