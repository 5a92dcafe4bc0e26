"""The contract of model.json and model.npz, which other programs read."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from jaxtyping import AbstractDtype, Float64, Int64, UInt8
from pydantic import Field, model_validator

from schemas.artifact import GREATEST, Artifact, Rigid, Schema, Unit, Within
from schemas.assessment import Spread, Verdict
from schemas.joints import JOINT_KINDS, JointKind, JointType, is_tree, parents_first
from schemas.seal import sha256
from schemas.sequence import LengthUnit

if TYPE_CHECKING:
    from jaxtyping import Float as Float32or64
else:

    class Float32or64(AbstractDtype):
        """Real numbers in single or double precision."""

        dtypes = ("float32", "float64")


Vector = tuple[float, float, float]
Numbers = float | tuple[float, ...]
"""One number for each degree of freedom of a joint: a plain number for one, a tuple for several."""


def are(numbers: Numbers, count: int) -> bool:
    """Whether there are `count` numbers: one plain number, or a tuple of several."""
    return isinstance(numbers, tuple) == (count != 1) and np.size(numbers) == count


class ModelPart(Schema):
    id: int
    name: str
    point_count: int = Field(ge=0)


class JointConfidence(Schema):
    """The fit's confidence, from 0 to 1, in the two parts, in their link and in the joint's type."""

    part: float = Field(ge=0, le=1)
    link: float = Field(ge=0, le=1)
    type: float = Field(ge=0, le=1)


class ModelJoint(Schema):
    """One joint, in the canonical frame. Lengths are in the input's units, angles in radians.

    `point` is the point of the axis nearest to where the joint's parts touch, as far as the fit knows. A spherical
    joint turns about it; its states are rotation vectors, and `lower` and `upper` limit their lengths. Any other joint
    with several degrees of freedom has one number for each in its states and limits (schemas.joints).
    """

    id: int
    name: str
    parent: int
    child: int
    type: JointType
    axis: Vector
    point: Vector
    lower: Numbers
    upper: Numbers
    confidence: JointConfidence | None = None
    spread: Spread | None = Field(default=None, description="of the axis at `point`")
    states: tuple[Numbers, ...]

    @property
    def kind(self) -> JointKind:
        return JOINT_KINDS[self.type]

    @property
    def lowers(self) -> tuple[float, ...]:
        """The lower limit of each of `sizes`."""
        return self.lower if isinstance(self.lower, tuple) else (self.lower,)

    @property
    def uppers(self) -> tuple[float, ...]:
        """The upper limit of each of `sizes`."""
        return self.upper if isinstance(self.upper, tuple) else (self.upper,)

    def ranges(self, length: str) -> list[tuple[float, float, str]]:
        """Lower limit, upper limit and unit symbol of each of `sizes`. `length` is the symbol for lengths."""
        return list(zip(self.lowers, self.uppers, self.kind.symbols(length), strict=False))

    def sizes(self, state: Numbers) -> tuple[float, ...]:
        """The quantities that have limits: the numbers of a state, or the length of a rotation vector."""
        if self.kind.is_ball:
            return (math.hypot(*np.atleast_1d(state)),)
        return tuple(np.atleast_1d(state).tolist())

    @model_validator(mode="after")
    def _check_values(self) -> Self:
        expected = self.kind.size
        if not all(are(state, expected) for state in self.states):
            raise ValueError(f"joint {self.name}: states: expected {expected} numbers each, since it is {self.type}")
        limits = 1 if self.kind.is_ball else expected
        if not are(self.lower, limits) or not are(self.upper, limits):
            raise ValueError(f"joint {self.name}: limits: expected {limits} numbers each, since it is {self.type}")
        if not all(np.isfinite(state).all() for state in self.states):
            raise ValueError(f"joint {self.name}: states: found NaN or infinity, expected finite values")
        if not abs(math.hypot(*self.axis) - 1.0) < 1e-3 or not np.isfinite(self.point).all():
            raise ValueError(
                f"joint {self.name}: found axis {self.axis} through {self.point}, expected a unit axis through a point"
            )
        if not all(-np.inf < low <= high < np.inf for low, high in zip(self.lowers, self.uppers, strict=True)):
            raise ValueError(f"joint {self.name}: found limits {self.lower} to {self.upper}, expected lower <= upper")
        if (greatest := np.abs(np.hstack([*self.states, self.point, *self.lowers, *self.uppers])).max()) > GREATEST:
            raise ValueError(f"joint {self.name}: found a number of size {greatest:g}, expected at most {GREATEST:g}")
        return self


class ModelFile(Schema):
    """The content of model.json. `model.npz` beside it holds canonical_points, labels and T_frame_canonical.

    Where the scans have colours, it also holds `colours` of the canonical points.

    In version 2 canonical_points are 64-bit floats, because 32-bit floats cannot separate nearby points far from the
    origin. Files of earlier releases have no digests. Whoever edits a file by hand must remove its digest.
    """

    format: Literal["rearticulate/model"] = "rearticulate/model"
    version: Literal[1, 2] = 1
    json_sha256: str | None = Field(default=None, description="of this file, with zeros in place of the digest")
    npz_sha256: str | None = Field(default=None, description="of model.npz")
    units: LengthUnit
    frames: int = Field(gt=0)
    canonical_frame: int = Field(ge=0)
    root: int = Field(ge=0)
    verdict: Verdict | None = Field(default=None, description="how far the model can be trusted, and why")
    parts: tuple[ModelPart, ...]
    joints: tuple[ModelJoint, ...]

    @property
    def digest(self) -> str:
        """A digest of the content of model.json, which identifies this model: all but how far it can be trusted."""
        aside: dict[str, Any] = dict.fromkeys(("json_sha256", "npz_sha256", "verdict"), True)
        aside["joints"] = {"__all__": {"spread"}}
        return sha256(self.model_dump_json(exclude=aside).encode())[:16]

    def joints_from_root(self) -> list[ModelJoint]:
        """The joints, each after the joint that moves its parent part."""
        order = parents_first([joint.parent for joint in self.joints], [joint.child for joint in self.joints])
        return [self.joints[index] for index in order]

    @model_validator(mode="after")
    def _check_model(self) -> Self:
        if problem := next(self._contradictions(), None):
            raise ValueError(problem)
        return self

    def _contradictions(self) -> Iterator[str]:
        parts = list(range(len(self.parts)))
        if [part.id for part in self.parts] != parts:
            yield f"parts: found ids {[part.id for part in self.parts]}, expected {parts}"
        for kind, names in (("parts", [p.name for p in self.parts]), ("joints", [j.name for j in self.joints])):
            if twice := sorted(name for name, count in Counter(names).items() if count > 1 or not name):
                yield f"{kind}: found the name {twice[0][:80]!r} twice or empty, expected one for each"
            if strange := [name for name in names if not name.isprintable()]:
                yield f"{kind}: found the name {strange[0][:80]!r}, expected printable characters only"
        parent, child = [joint.parent for joint in self.joints], [joint.child for joint in self.joints]
        if len(child) + 1 != len(parts) or not is_tree(parent, child, self.root):
            yield (
                f"joints: found a cycle, or parts that do not hang on the root by one joint each, "
                f"expected a tree over {len(parts)} parts with root {self.root}"
            )
        if self.canonical_frame >= self.frames:
            yield f"canonical_frame: found {self.canonical_frame}, expected one of the {self.frames} frames"
        for joint in self.joints:
            count = len(joint.states)
            if count != self.frames:
                yield f"joint {joint.name}: found {count} states, expected one for each of {self.frames} frames"


class Result(Artifact):
    """The artifact of the result stage: the content of model.json and model.npz, in the input's units."""

    model: ModelFile
    canonical_points: Annotated[Float32or64[np.ndarray, "points 3"], Unit("input")]
    labels: Annotated[Int64[np.ndarray, "points"], Unit("index"), Within(0, "parts")]
    T_frame_canonical: Annotated[Float64[np.ndarray, "frames parts 4 4"], Unit("input"), Rigid()]
    colours: Annotated[UInt8[np.ndarray, "points 3"] | None, Unit("sRGB")] = Field(
        default=None, description="red, green and blue of canonical_points, if the scans have colours"
    )

    @model_validator(mode="after")
    def _check_sizes(self) -> Self:
        found, expected = self.T_frame_canonical.shape[:2], (self.model.frames, len(self.model.parts))
        if found != expected:
            raise ValueError(
                f"Result.T_frame_canonical: found {found} frames and parts, expected {expected} as in model"
            )
        return self
