"""Validation of a URDF: its names, its numbers, and the links of its joints."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from schemas.errors import InputError, quoted

GREATEST_METRES = 1e9  # greater metres, radians and factors are mistakes


@dataclass(frozen=True)
class Numbers:
    """An attribute of numbers: the allowed counts, and whether it is required, may be infinite or have commas."""

    counts: tuple[int, ...] = (1,)
    required: bool = False
    endless: bool = False
    commas: bool = False  # between the numbers; yourdfpy accepts them in these attributes alone


NUMBERS: dict[str, dict[str, Numbers]] = {
    "origin": {"xyz": Numbers((3,)), "rpy": Numbers((3,))},
    "axis": {"xyz": Numbers((3,))},
    "limit": {name: Numbers(endless=True) for name in ("lower", "upper", "effort", "velocity")},
    "mimic": {"multiplier": Numbers(), "offset": Numbers()},
    "box": {"size": Numbers((3,), required=True, commas=True)},
    "cylinder": {"radius": Numbers(required=True), "length": Numbers(required=True)},
    "sphere": {"radius": Numbers(required=True)},
    "mesh": {"scale": Numbers((0, 1, 3), commas=True)},
}
# element -> its children that are read; other elements, such as <inertial> or <gazebo>, may hold anything
READ: dict[str, set[str]] = {
    "robot": {"link", "joint"},
    "link": {"visual", "collision"},
    "visual": {"origin", "geometry"},
    "collision": {"origin", "geometry"},
    "geometry": {"box", "cylinder", "sphere", "mesh"},
    "joint": {"origin", "parent", "child", "axis", "limit", "mimic"},
}
SHAPES = ("box", "cylinder", "sphere", "mesh")


def check_urdf(root: Element, urdf_path: Path) -> None:
    """Raise InputError for the first fault, in one line that names the file and the element."""
    for problem in _problems(root):
        raise InputError(f"{urdf_path}: {problem}; correct the URDF")


def pruned(element: Element) -> Element:
    """Copy only the elements that are read, so that no others can cause errors."""
    copy = Element(element.tag, element.attrib)
    copy.extend(pruned(child) for child in element if child.tag in READ.get(element.tag, ()))
    return copy


def _problems(root: Element) -> Iterator[str]:
    if root.tag != "robot":
        yield f"found the element <{root.tag[:80]}>, expected <robot>"
    if root.get("name") is None:
        yield "found a <robot> without a name, expected one"
    links, joints = root.findall("link"), root.findall("joint")
    yield from _name_problems("link", links)
    yield from _name_problems("joint", joints)
    for link in links:
        for role in ("visual", "collision"):
            for element in link.findall(role):
                yield from _shape_problems(f"link {quoted(link.get('name'))}, <{role}>", element)
    for joint in joints:
        yield from _joint_problems(f"joint {quoted(joint.get('name'))}", joint)


def _name_problems(kind: str, elements: list[Element]) -> Iterator[str]:
    names: set[str] = set()
    for number, element in enumerate(elements, start=1):
        name = element.get("name")
        if not name:
            yield f"{kind} {number}: found no name, expected one"
        elif not name.isprintable():
            yield f"{kind} {quoted(name)}: found characters that cannot be printed, expected a plain name"
        elif name in names:
            yield f"{kind} {quoted(name)}: found twice, expected one {kind} of each name"
        else:
            names.add(name)


def _shape_problems(where: str, element: Element) -> Iterator[str]:
    shape = element.find("geometry/*")
    if shape is None or shape.tag not in SHAPES:
        found = "nothing" if shape is None else f"<{shape.tag[:80]}>"
        yield f"{where}: found {found} in <geometry>, expected one of {', '.join(SHAPES)}"
        return
    if shape.tag == "mesh" and not shape.get("filename"):
        yield f"{where}: found a <mesh> without a file name, expected one"
    for child in (shape, *element.findall("origin")):
        yield from _number_problems(where, child)


def _joint_problems(where: str, joint: Element) -> Iterator[str]:
    for role in ("parent", "child"):
        element = joint.find(role)
        if element is None or not element.get("link"):
            yield f"{where}: found no {role} link, expected one"
    mimic = joint.find("mimic")
    if mimic is not None and not mimic.get("joint"):
        yield f"{where}: found that it mimics a joint without a name, expected one"
    for child in joint:
        yield from _number_problems(where, child)


def _number_problems(where: str, element: Element) -> Iterator[str]:
    for attribute, numbers in NUMBERS.get(element.tag, {}).items():
        text = element.get(attribute)
        here = f"{where}: <{element.tag} {attribute}={quoted(text)}>"
        if text is None:
            if numbers.required:
                yield f"{where}: found <{element.tag}> without {attribute}, expected it"
            continue
        words = (text.replace(",", " ") if numbers.commas else text).split()
        if strange := [word for word in words if not _is_number(word)]:
            yield f"{here}: found no number in {quoted(strange[0])}, expected {_counted(numbers)}"
            continue
        values = [float(word) for word in words]
        if len(values) not in numbers.counts:
            yield f"{here}: found {len(values)} numbers, expected {_counted(numbers)}"
        endless = [value for value in values if not math.isfinite(value)]
        if endless and not (numbers.endless and not math.isnan(endless[0])):
            yield f"{here}: found {endless[0]}, expected finite numbers"
        elif not numbers.endless and any(abs(value) > GREATEST_METRES for value in values):
            yield f"{here}: found a number beyond {GREATEST_METRES:g}, expected one that metres or radians can be"


def _is_number(word: str) -> bool:
    """Whether a word is a number for other URDF readers, too. Only Python accepts 1_0 and digits of other scripts."""
    try:
        float(word)
    except ValueError:
        return False
    return word.isascii() and "_" not in word


def _counted(numbers: Numbers) -> str:
    apart = ", set apart by spaces" if max(numbers.counts) > 1 else ""
    return f"{' or '.join(map(str, filter(None, numbers.counts)))} of them{apart}"
