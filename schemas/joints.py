"""The table of joint kinds, with one row for each kind. Everything that depends on a kind follows from its row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float64, Int64
from pydantic import AfterValidator

Freedom = Literal["none", "axis", "all"]
"""The directions in which a joint's child can turn or slide: none, its axis, or all."""

DEGREES: dict[Freedom, int] = {"none": 0, "axis": 1, "all": 3}


@dataclass(frozen=True)
class JointKind:
    """The motion that a kind of joint allows: its child turns about the joint's point, then slides.

    A joint's state has one number for each degree of freedom: first angles in radians, then lengths. Three angles form
    a rotation vector.
    """

    name: str
    mark: str
    turns: Freedom
    slides: Freedom

    @property
    def angles(self) -> int:
        """The number of angles in a state."""
        return DEGREES[self.turns]

    @property
    def size(self) -> int:
        """The number of values in a state."""
        return DEGREES[self.turns] + DEGREES[self.slides]

    @property
    def is_ball(self) -> bool:
        """Whether the angles form a rotation vector. Limits then apply to its length."""
        return self.turns == "all"

    @property
    def has_axis(self) -> bool:
        """Whether the motion has a direction."""
        return "axis" in (self.turns, self.slides)

    def basis(self, axis: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "size 6"]:
        """One row for each number of the state: the rotation vector and the slide that one unit of it adds."""
        directions = {"none": np.zeros((0, 3)), "axis": axis[None], "all": np.eye(3)}
        basis = np.zeros((self.size, 6))
        basis[: self.angles, :3] = directions[self.turns]
        basis[self.angles :, 3:] = directions[self.slides]
        return basis

    def units(self, length: float) -> Float64[np.ndarray, "size"]:
        """The unit of each number of a state: one radian or `length`."""
        return np.repeat([1.0, length], [self.angles, self.size - self.angles])

    def symbols(self, length: str) -> tuple[str, ...]:
        """The unit symbol of each number of a state: rad, or that of `length`."""
        return ("rad",) * self.angles + (length,) * (self.size - self.angles)


FIXED = JointKind("fixed", "", "none", "none")
REVOLUTE = JointKind("revolute", "R", "axis", "none")
PRISMATIC = JointKind("prismatic", "P", "none", "axis")
SPHERICAL = JointKind("spherical", "S", "all", "none")
SCREW = JointKind("screw", "C", "axis", "axis")
"""A joint of undecided kind, which may turn about its axis and slide along it."""
FREE = JointKind("free", "F", "all", "all")
"""The free motion of a root in the world."""

JOINT_KINDS: dict[str, JointKind] = {kind.name: kind for kind in (REVOLUTE, PRISMATIC, SPHERICAL)}
"""The kinds that a fitted model may have, by name. A kind added here can be fitted, posed and exported."""


def joint_kind(name: str) -> JointKind:
    """Look up a kind by its name. Raises ValueError for an unknown name."""
    if name not in JOINT_KINDS:
        raise ValueError(f"expected one of {', '.join(JOINT_KINDS)}")
    return JOINT_KINDS[name]


def _known(name: str) -> str:
    return joint_kind(name).name


JointType = Annotated[str, AfterValidator(_known)]
"""The name of one of JOINT_KINDS."""


Links = Sequence[int] | Int64[np.ndarray, "joints"]


def parents_first(parent: Links, child: Links) -> list[int]:
    """Order the joints of a tree so that each follows the joint that moves its parent part.

    Joints at a root come first. Joints that close a loop are left out.
    """
    children: dict[int, list[int]] = {}
    for joint, part in enumerate(np.asarray(parent).tolist()):
        children.setdefault(part, []).append(joint)
    below = np.asarray(child).tolist()
    front = sorted(set(children) - set(below))
    order: list[int] = []
    while front:
        joints = children.get(front.pop(), [])
        order += joints
        front += [below[joint] for joint in joints]
        if len(order) > len(below):  # two joints move the same part
            break
    return order


def is_tree(parent: Links, child: Links, root: int) -> bool:
    """Whether the joints form one tree of parts: every part except the root is the child of exactly one joint."""
    parts = list(range(len(child) + 1))
    return (
        sorted([root, *np.asarray(child).tolist()]) == parts
        and set(np.asarray(parent).tolist()) <= set(parts)
        and len(parents_first(parent, child)) == len(child)
    )
