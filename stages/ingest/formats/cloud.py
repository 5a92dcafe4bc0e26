"""A point cloud as a file holds it: coordinates, and colours if there are any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, UInt8

Points = Float64[np.ndarray, "points 3"]
Colours = UInt8[np.ndarray, "points 3"]

_BYTE, _SHORT = 255, 65535
_NAMES = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("rf", "gf", "bf"),  # CloudCompare's shares of one
)


@dataclass(frozen=True)
class Cloud:
    """Points in the file's coordinates, including NaN and infinity, and their colours (sRGB) if the file has them."""

    points: Points
    colours: Colours | None = None


def colour_columns(names: Sequence[str]) -> list[int]:
    """The columns named red, green and blue, or the like; none unless each is there once."""
    plain = [name.strip(" \t\"'").lower() for name in names]
    for wanted in _NAMES:
        if all(plain.count(name) == 1 for name in wanted):
            return [plain.index(name) for name in wanted]
    return []


def as_colours(values: np.ndarray) -> Colours | None:
    """Convert red, green and blue (points, 3) to bytes; None if they are no colours.

    Bytes stay as they are. The range of other numbers is known by the greatest: 1 (real numbers), 255 or 65535, since
    programs often write bytes into the 16 bits of LAS.
    """
    if values.dtype == np.uint8:
        return values
    known = np.where(np.isfinite(values), values, 0)
    greatest = known.max(initial=0)
    if known.min(initial=0) < 0 or greatest > _SHORT:
        return None
    if values.dtype.kind == "f" and greatest <= 1:
        known = known * _BYTE
    elif greatest > _BYTE:
        known = known * (_BYTE / _SHORT)
    return np.rint(known).astype(np.uint8)
