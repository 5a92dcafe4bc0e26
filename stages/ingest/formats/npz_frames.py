"""Detection of a sequence's frames among the arrays of an .npz, by names and shapes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from schemas.errors import InputError
from stages.ingest.formats.arrays import PER_FRAME, Member, open_npz
from stages.ingest.formats.cloud import Cloud, Points
from stages.ingest.messages import TooLargeError
from stages.ingest.order import in_order

_POINTS = ("points", "pc", "pcs", "pcd", "xyz", "point_clouds", "pointclouds", "clouds", "frames", "coords")
_FEWEST_ROWS = 5  # an array with fewer rows is a matrix
_FIRST = r"start|begin|first|initial|before|source|src|closed|close"
_LAST = r"end|last|final|after|target|tgt|opened|open"
_PLACE = re.compile(rf"[0-9]+|(?<![a-z])({_FIRST}|{_LAST})(?![a-z])", re.IGNORECASE)
_OF_POINTS = re.compile(
    r"(arr|frames?|points?|pcs?|pcd|pointclouds?|clouds?|scans?|xyz|t|time|step|state|"
    r"pos|positions?|p|coords?|coordinates?|verts?|vertex|vertices)?",
    re.I,
)
_EXPECTED = "one array of shape (frames, points, 3) or one of shape (points, 3) for each frame"


@dataclass(frozen=True)
class NpzFrames:
    """The frames in an .npz: one array of all frames, or one array for each."""

    stack: Member | None = None
    clouds: tuple[Member, ...] = ()
    doubt: str = ""  # a reason to doubt their order

    @property
    def count(self) -> int:
        return self.stack.shape[0] if self.stack else len(self.clouds)


def find_frames(path: Path) -> NpzFrames:
    """Find the frames by the headers alone. A single cloud (points, 3) is one frame. Raises InputError if unclear."""
    with open_npz(path) as archive:
        members = archive.members()
    stacks = [member for member in members if len(member.points_shape) == 3 and not member.problem]
    clouds = [member for member in members if _is_cloud(member)]
    if chosen := _by_name(stacks) or _only(stacks):
        return NpzFrames(stack=chosen)
    if not stacks:
        groups = _groups(clouds)
        if len(groups) > 1:
            groups = {prefix: of_prefix for prefix, of_prefix in groups.items() if _OF_POINTS.fullmatch(prefix)}
        if len(groups) == 1:
            return _in_time_order(next(iter(groups.values())))
        if not groups and (chosen := _by_name(clouds) or _only(clouds)):
            return NpzFrames(clouds=(chosen,))
    raise _unclear(path, members)


def read_npz_frames(path: Path, frames: NpzFrames, step: int, most: int) -> Iterator[tuple[str, Points]]:
    """Yield name and points of every `step`-th frame. Raises InputError, or TooLargeError beyond `most` points."""
    with open_npz(path) as archive:
        if frames.stack:
            for index, points in enumerate(archive.read_frames(frames.stack, step, most)):
                yield f"{path.name}[{index * step}]", points
            return
        for member in frames.clouds[::step]:
            points = archive.read_frame(member, most)
            most -= len(points)
            yield f"{path.name}[{member.name}]", points


def read_one_cloud(path: Path, most: int) -> Cloud:
    """Read the points of an .npz of one frame. Raises InputError, or ValueError if it holds more."""
    frames = find_frames(path)
    if frames.stack or frames.count != 1:
        raise ValueError(f"found {frames.count} frames among frames; give that file itself as the sequence")
    ((_, points),) = read_npz_frames(path, frames, 1, most)
    return Cloud(points)


def holds_one_cloud(path: Path) -> bool:
    """Whether an .npz is one frame rather than a sequence or something else."""
    try:
        frames = find_frames(path)
    except (InputError, TooLargeError):
        return False
    return frames.stack is None and frames.count == 1


def _is_cloud(member: Member) -> bool:
    return len(member.points_shape) == 2 and member.shape[0] >= _FEWEST_ROWS and not member.problem


def _by_name(members: list[Member]) -> Member | None:
    named = {member.name.lower(): member for member in reversed(members)}
    return next((named[name] for name in _POINTS if name in named), None)


def _only(members: list[Member]) -> Member | None:
    return members[0] if len(members) == 1 else None


def _groups(clouds: list[Member]) -> dict[str, list[Member]]:
    """Groups of at least two clouds whose names differ only in a number or in a word for start or end."""
    groups: dict[str, list[Member]] = {}
    for member in clouds:
        if place := next(reversed(list(_PLACE.finditer(member.name))), None):
            prefix = (member.name[: place.start()] + member.name[place.end() :]).strip("_-. []")
            groups.setdefault(prefix, []).append(member)
    return {prefix: members for prefix, members in groups.items() if len(members) > 1}


def _in_time_order(members: list[Member]) -> NpzFrames:
    by_name = {member.name: member for member in members}
    if any(character.isdigit() for character in "".join(by_name)):
        order = in_order(list(by_name))
        return NpzFrames(clouds=tuple(by_name[name] for name in order.names), doubt=order.doubt and order.message())
    last = re.compile(rf"(?<![a-z])({_LAST})(?![a-z])", re.IGNORECASE)
    return NpzFrames(clouds=tuple(sorted(members, key=lambda member: last.search(member.name) is not None)))


def _unclear(path: Path, members: list[Member]) -> InputError:
    found = ", ".join(f"{member.name} {member.shape or ''}".strip() for member in members[:8])
    more = ", ..." if len(members) > 8 else ""
    objects = next((member for member in members if "Python objects" in member.problem), None)
    remedy = "name the array 'points', or the frames frame_0, frame_1, ..."
    if len(members) == 1 and members[0].problem:
        remedy = PER_FRAME if objects else "save the frames again with np.savez"
        return InputError(f"{path}: '{members[0].name}' {members[0].problem}, expected {_EXPECTED}; {remedy}")
    if objects is not None:
        remedy = f"'{objects.name}' holds Python objects, which are never unpickled: {PER_FRAME}"
    elif any(len(member.shape) == 3 and member.shape[1] == 3 for member in members):
        remedy = "save the transpose, array.transpose(0, 2, 1)"
    return InputError(f"{path}: found {found or 'no array'}{more}, expected {_EXPECTED}; {remedy}")
