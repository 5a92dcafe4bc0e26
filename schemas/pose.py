"""The contract of pose.json, a model's pose, which `reart pose` writes and reads."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from schemas.artifact import GREATEST, Schema
from schemas.model_file import Numbers
from schemas.sequence import LengthUnit

State = Numbers  # radians and input units
Row = tuple[float, float, float, float]
Transform = tuple[Row, Row, Row, Row]


class TargetFit(Schema):
    """The distances of the posed source points from their targets, in the input's units."""

    rms: float
    greatest: float
    residuals: tuple[float, ...]


class Pose(Schema):
    """The joints' states by name and the root's transform from the canonical frame; input units and radians.

    The targets do not determine the states of the `undetermined` joints, which stay as in the nearest observed frame.
    The joints `at_limit` would go beyond their limits to come closer to the targets.
    """

    format: Literal["rearticulate/pose"] = "rearticulate/pose"
    version: Literal[1] = 1
    model_digest: str = Field(description="ModelFile.digest of the model that was posed")
    units: LengthUnit
    states: dict[str, State]
    T_pose_root: Transform
    undetermined: tuple[str, ...] = ()
    base_undetermined: bool = False
    at_limit: tuple[str, ...] = ()
    targets: TargetFit | None = Field(default=None, description="only if the pose was found by targets")

    @model_validator(mode="after")
    def _check_root(self) -> Self:
        T = np.array(self.T_pose_root)
        R = T[:3, :3]
        sane = bool((np.abs(T) <= GREATEST).all())
        if not sane or not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
            raise ValueError("T_pose_root: found no rigid motion, expected a rotation and a translation")
        return self
