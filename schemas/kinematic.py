"""The kinematic model that projection, merging and the final fit hand on, and the choice among candidates."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from jaxtyping import Float64, Int64
from pydantic import Field, model_validator

from schemas.artifact import Artifact, Rigid, Schema, Unit, Within

LinkType = Literal["screw", "revolute", "prismatic"]
CONFIDENCES = ("part", "link", "type")


class KinematicModel(Artifact):
    """Rigid parts, linked to a tree by screw joints; normalised coordinates of the canonical frame.

    Joint j moves part `joint_child[j]` against `joint_parent[j]`; every part but the root is the child of
    exactly one joint. In frame t the child is turned by `states[j, t, 0]` (radians) about the axis and
    moved by `states[j, t, 1]` along it. Before the final fit joints are of type "screw" and both may be
    non-zero; after it one of the two is exactly zero in every frame. All states are zero in the
    canonical frame.

    `confidence` has a column for each of CONFIDENCES: whether both parts are ones of their own, whether they are linked
    to each other by one degree of freedom, and whether that is of the joint's type. Only the final fit tells it.
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
        description="the point of the axis nearest the origin"
    )
    states: Annotated[Float64[np.ndarray, "joints frames 2"], Unit("radian, normalised")]
    e_spatial: Annotated[Float64[np.ndarray, "joints"], Unit("normalised squared")]
    e_1dof: Annotated[Float64[np.ndarray, "joints"], Unit("normalised squared")]
    confidence: Annotated[Float64[np.ndarray, "joints 3"] | None, Unit("1"), Within(0, 1)] = Field(
        default=None, description="from 0, as good as another explanation, to 1, sure; columns as in CONFIDENCES"
    )
    energies: dict[str, float] = Field(description="E_project, E_group, E_recons, ... of the whole model")

    @property
    def part_count(self) -> int:
        return self.Ts_frame_canonical.shape[1]

    def parents(self) -> Int64[np.ndarray, "parts"]:
        """The parent of each part; -1 for the root."""
        parents = np.full(self.part_count, -1, dtype=np.int64)
        parents[self.joint_child] = self.joint_parent
        return parents

    def joints_from_root(self) -> list[int]:
        """Joint indices ordered so that a joint comes after its parent part's own joint."""
        order: list[int] = []
        front = [self.root]
        while front:
            part = front.pop()
            children = np.flatnonzero(self.joint_parent == part)
            order += children.tolist()
            front += self.joint_child[children].tolist()
        return order

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
        if len(self.joints_from_root()) != parts - 1:
            raise ValueError(f"KinematicModel: not every part hangs on the root {self.root}; the joints close a loop")
        for name, kind in (("angle", "prismatic"), ("distance", "revolute")):
            column = 0 if name == "angle" else 1
            for joint, joint_type in enumerate(self.joint_types):
                if joint_type == kind and np.any(self.states[joint, :, column] != 0):
                    raise ValueError(f"KinematicModel.states: joint {joint} is {kind}, its {name} must be zero")
        return self


class Candidate(Schema):
    """One candidate canonical frame and what speaks for it."""

    frame: int = Field(ge=0)
    parts: int = Field(ge=1)
    e_project: float
    e_group: float
    e_fit: float


class CanonicalChoice(Artifact):
    """The candidate with the lowest energy (A.5), and its model."""

    candidates: tuple[Candidate, ...]
    model: KinematicModel
