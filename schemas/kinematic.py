"""The kinematic model that projection, merging and the final fit exchange, and the choice among candidates."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from jaxtyping import Float64, Int64
from pydantic import AfterValidator, Field, model_validator

from schemas.artifact import Artifact, Rigid, Schema, Unit, Within
from schemas.joints import JOINT_KINDS, SCREW, JointKind, joint_kind, parents_first


def _screw_or_decided(name: str) -> str:
    return name if name == SCREW.name else joint_kind(name).name


LinkType = Annotated[str, AfterValidator(_screw_or_decided)]
"""The name of a joint's kind, which is "screw" until the final fit decides."""

CONFIDENCES = ("part", "link", "type")


class KinematicModel(Artifact):
    """Rigid parts that joints link to a tree, in normalised coordinates of the canonical frame.

    Joint j moves part `joint_child[j]` relative to `joint_parent[j]`. Every part except the root is the child of
    exactly one joint. Before the final fit all joints are screws, which turn about their axis and slide along it.

    `states` has a column for each number of a joint's state (schemas.joints), joint after joint. States are zero in
    the canonical frame.

    `confidence` has a column for each of CONFIDENCES: that both parts are distinct parts, that one degree of freedom
    links them to each other, and that the joint has the stated type. Only the final fit sets it.
    """

    canonical_frame: Annotated[int, Within(0, "frames")]
    root: Annotated[int, Within(0, "parts")]
    labels: Annotated[Int64[np.ndarray, "points"], Unit("index"), Within(0, "parts")]
    Ts_frame_canonical: Annotated[Float64[np.ndarray, "frames parts 4 4"], Unit("normalised"), Rigid()]
    joint_parent: Annotated[Int64[np.ndarray, "joints"], Unit("index"), Within(0, "parts")]
    joint_child: Annotated[Int64[np.ndarray, "joints"], Unit("index"), Within(0, "parts")]
    joint_types: tuple[LinkType, ...]
    axis: Annotated[Float64[np.ndarray, "joints 3"], Unit("1")] = Field(description="unit direction")
    point: Annotated[Float64[np.ndarray, "joints 3"], Unit("normalised")] = Field(
        description="the point of the axis nearest the origin, or the centre of a joint without an axis"
    )
    states: Annotated[Float64[np.ndarray, "frames coordinates"], Unit("radian, normalised")]
    e_spatial: Annotated[Float64[np.ndarray, "joints"], Unit("normalised squared")]
    e_1dof: Annotated[Float64[np.ndarray, "joints"], Unit("normalised squared")]
    confidence: Annotated[Float64[np.ndarray, "joints 3"] | None, Unit("1"), Within(0, 1)] = Field(
        default=None, description="from 0 (another explanation is as good) to 1 (certain); columns as in CONFIDENCES"
    )
    energies: dict[str, float] = Field(description="E_project, E_group, E_recons, ... of the whole model")

    @property
    def part_count(self) -> int:
        return self.Ts_frame_canonical.shape[1]

    def parents(self) -> Int64[np.ndarray, "parts"]:
        """The parent of each part, -1 for the root."""
        parents = np.full(self.part_count, -1, dtype=np.int64)
        parents[self.joint_child] = self.joint_parent
        return parents

    @property
    def kinds(self) -> tuple[JointKind, ...]:
        """The kind of each joint."""
        return tuple(SCREW if name == SCREW.name else JOINT_KINDS[name] for name in self.joint_types)

    def states_of(self, joint: int) -> Float64[np.ndarray, "frames size"]:
        """The states of one joint in all frames."""
        first = sum(kind.size for kind in self.kinds[:joint])
        return self.states[:, first : first + self.kinds[joint].size]

    @model_validator(mode="after")
    def _check_tree(self) -> Self:
        parts = self.part_count
        if len(self.labels) == 0:
            raise ValueError("KinematicModel.labels: found none, expected one for each point")
        lengths = np.linalg.norm(self.axis, axis=1)
        if np.any(np.abs(lengths - 1) > 1e-3):
            raise ValueError(
                f"KinematicModel.axis: found a length of {lengths[np.argmax(np.abs(lengths - 1))]:g}, expected 1"
            )
        if len(self.joint_types) != len(self.joint_child):
            raise ValueError(
                f"KinematicModel.joint_types: found {len(self.joint_types)}, expected {len(self.joint_child)}"
            )
        if not 0 <= self.root < parts or sorted([self.root, *self.joint_child.tolist()]) != list(range(parts)):
            raise ValueError("KinematicModel: every part but the root must be the child of exactly one joint")
        if len(parents_first(self.joint_parent, self.joint_child)) != parts - 1:
            raise ValueError(f"KinematicModel: not every part hangs on the root {self.root}; the joints close a loop")
        expected = sum(kind.size for kind in self.kinds)
        if self.states.shape[1] != expected:
            raise ValueError(f"KinematicModel.states: found {self.states.shape[1]} columns, expected {expected}")
        return self


class Candidate(Schema):
    """One candidate canonical frame and its energies."""

    frame: int = Field(ge=0)
    parts: int = Field(ge=1)
    e_project: float
    e_group: float
    e_fit: float


class CanonicalChoice(Artifact):
    """The candidate with the lowest energy (A.5), and its model."""

    candidates: tuple[Candidate, ...]
    model: KinematicModel
