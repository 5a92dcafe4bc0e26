"""Makes the URDFs of three everyday things, look-alikes of figure 2 of the paper's supplement.

A toy truck has one hinge. A game console has two controllers that slide a little. An office chair swivels, slides
up and has a back that tilts.

    python benchmarks/look_alikes.py OUT
    reart run --dataset urdf-phone --data OUT --workdir WORKDIR
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

Numbers = Sequence[float]


def written(numbers: Numbers) -> str:
    return " ".join(f"{number:g}" for number in numbers)


def box(size: Numbers, at: Numbers = (0, 0, 0), turned: Numbers = (0, 0, 0)) -> str:
    return _visual(f'<box size="{written(size)}"/>', at, turned)


def cylinder(radius: float, length: float, at: Numbers = (0, 0, 0), turned: Numbers = (0, 0, 0)) -> str:
    return _visual(f'<cylinder radius="{radius:g}" length="{length:g}"/>', at, turned)


def _visual(shape: str, at: Numbers, turned: Numbers) -> str:
    return f'<visual><origin xyz="{written(at)}" rpy="{written(turned)}"/><geometry>{shape}</geometry></visual>'


def joint(kind: str, parent: str, child: str, at: Numbers, axis: Numbers, lower: float, upper: float) -> str:
    return (
        f'<joint name="{child}_joint" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{written(at)}"/><axis xyz="{written(axis)}"/>'
        f'<limit lower="{lower:g}" upper="{upper:g}" effort="1" velocity="1"/></joint>'
    )


def robot(name: str, links: dict[str, list[str]], joints: list[str]) -> str:
    shown = [f'<link name="{link}">{"".join(visuals)}</link>' for link, visuals in links.items()]
    return f'<?xml version="1.0"?>\n<robot name="{name}">\n' + "\n".join([*shown, *joints]) + "\n</robot>\n"


def toy() -> str:
    """A truck whose bed tips."""
    wheels = [cylinder(0.06, 0.04, (x, y, 0.06), (1.5708, 0, 0)) for x in (-0.18, 0.16) for y in (-0.14, 0.14)]
    chassis = [box((0.6, 0.2, 0.04), (0, 0, 0.1)), box((0.16, 0.24, 0.22), (0.22, 0, 0.23)), *wheels]
    bed = [
        box((0.4, 0.26, 0.02), (0.2, 0, 0.02)),
        *(box((0.4, 0.02, 0.14), (0.2, y, 0.09)) for y in (-0.12, 0.12)),
        box((0.02, 0.26, 0.2), (0.39, 0, 0.12)),
    ]
    tip = joint("revolute", "chassis", "bed", (-0.28, 0, 0.13), (0, -1, 0), 0.0, 0.9)
    return robot("toy", {"chassis": chassis, "bed": bed}, [tip])


def switch() -> str:
    """A game console whose controllers slide up along its sides."""
    console = [
        box((0.24, 0.014, 0.1)),
        box((0.2, 0.004, 0.08), (0, -0.009, 0)),
        box((0.05, 0.02, 0.02), (0, 0.016, -0.03)),
    ]
    links, joints = {"console": console}, []
    for side, x in (("left", -0.136), ("right", 0.136)):
        stick = cylinder(0.01, 0.014, (0, -0.018, 0.02), (1.5708, 0, 0))
        links[side] = [box((0.03, 0.026, 0.1)), stick, box((0.012, 0.004, 0.012), (0, -0.015, -0.02))]
        joints.append(joint("prismatic", "console", side, (x, 0, 0), (0, 0, 1), 0.0, 0.05))
    return robot("switch", links, joints)


def chair() -> str:
    """An office chair: its column swivels on the base, its seat slides up on the column, its back tilts."""
    legs = [box((0.3, 0.05, 0.04), (0.15, 0, 0.05)), box((0.3, 0.05, 0.04), (-0.15, 0, 0.05))]
    legs += [box((0.05, 0.3, 0.04), (0, 0.15, 0.05)), box((0.05, 0.3, 0.04), (0, -0.15, 0.05))]
    base = [*legs, cylinder(0.045, 0.12, (0, 0, 0.1))]
    lever = cylinder(0.012, 0.3, (0.02, 0.22, 0.1), (1.5708, 0, 0))
    column = [cylinder(0.03, 0.2), box((0.2, 0.16, 0.08), (0, 0, 0.1)), lever]
    seat = [box((0.44, 0.46, 0.06), (0.02, 0, 0.05)), *(box((0.2, 0.04, 0.2), (0.02, y, 0.16)) for y in (-0.25, 0.25))]
    back = [box((0.05, 0.4, 0.5), (0, 0, 0.33)), box((0.03, 0.08, 0.12), (0, 0, 0.06))]
    joints = [
        joint("revolute", "base", "column", (0, 0, 0.25), (0, 0, 1), -1.2, 1.2),
        joint("prismatic", "column", "seat", (0, 0, 0.14), (0, 0, 1), 0.0, 0.14),
        joint("revolute", "seat", "back", (-0.22, 0, 0.06), (0, 1, 0), -0.7, 0.2),
    ]
    return robot("chair", {"base": base, "column": column, "seat": seat, "back": back}, joints)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="a folder for NAME/NAME.urdf")
    out = parser.parse_args().out
    for make in (toy, switch, chair):
        folder = out / make.__name__
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{make.__name__}.urdf").write_text(make(), encoding="utf-8")


if __name__ == "__main__":
    main()
