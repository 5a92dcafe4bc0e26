"""A tiny robot of boxes, cylinders and spheres, written out as a URDF."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest


@dataclass(frozen=True)
class UrdfWriter:
    """Elements of a URDF as text, and the file that they make."""

    folder: Path

    def shape(self, geometry: str, xyz: str = "0 0 0", rpy: str = "0 0 0", role: str = "visual") -> str:
        return f'<{role}><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry></{role}>'

    def box(self, size: str, xyz: str = "0 0 0", rpy: str = "0 0 0", role: str = "visual") -> str:
        return self.shape(f'<box size="{size}"/>', xyz, rpy, role)

    def link(self, name: str, *shapes: str) -> str:
        return f'<link name="{name}">{"".join(shapes)}</link>'

    def joint(
        self, name: str, kind: str, parent: str, child: str, extra: str = "", xyz: str = "0 0 0", rpy: str = "0 0 0"
    ) -> str:
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/>{extra}</joint>'
        )

    def moves(self, axis: str, lower: float, upper: float) -> str:
        return f'<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'

    def write(self, *elements: str) -> Path:
        path = self.folder / "robot.urdf"
        path.write_text(f'<robot name="tiny">{"".join(elements)}</robot>')
        return path


@pytest.fixture
def urdf(tmp_path: Path) -> UrdfWriter:
    return UrdfWriter(tmp_path)


@pytest.fixture
def arm(urdf: UrdfWriter) -> Path:
    """An arm with a button too small to see, a slide, a limited shoulder, and a flag that mimics the shoulder."""
    mimic = '<mimic joint="shoulder" multiplier="-0.5" offset="0.6"/>'
    return urdf.write(
        urdf.link("world"),
        urdf.link("base", urdf.box("0.4 0.4 0.2")),
        urdf.link("upper", urdf.shape('<cylinder radius="0.06" length="0.5"/>', "0 0 0.25", "0 0.1 0.2")),
        urdf.link("button", urdf.box("0.01 0.01 0.01")),
        urdf.link("fore", urdf.box("0.1 0.08 0.4", "0 0 0.2")),
        urdf.link("slide", urdf.shape('<sphere radius="0.1"/>'), urdf.box("0.3 0.05 0.05", "0 0 0", "0.3 0.5 -1")),
        urdf.link("flag", urdf.box("0.05 0.3 0.05"), urdf.box("0.2 0.2 0.2", role="collision")),
        urdf.joint("mount", "fixed", "world", "base", xyz="0.3 -0.2 0.1", rpy="0 0 0.4"),
        urdf.joint("shoulder", "revolute", "base", "upper", urdf.moves("0 2 1", 0.3, 2.5), "0 0 0.2", "0.1 0 0.3"),
        urdf.joint("press", "revolute", "upper", "button", urdf.moves("1 0 0", -1, 1), "0.07 0 0.2"),
        urdf.joint("elbow", "continuous", "upper", "fore", '<axis xyz="1 0 0"/>', "0 0 0.6", "0 0.2 0"),
        urdf.joint("rail", "prismatic", "fore", "slide", urdf.moves("0 0 -1", -0.3, -0.1), "0 0 0.4", "0.3 0 0"),
        urdf.joint("echo", "revolute", "base", "flag", urdf.moves("0 0 1", -0.5, 1.2) + mimic, "-0.4 0 0"),
    )
