"""Colours for any number of parts."""

from __future__ import annotations

import colorsys

import numpy as np
from jaxtyping import Float


def part_colours(count: int) -> Float[np.ndarray, "parts 3"]:
    """Colours that stay apart: hues by the golden ratio, lightness in turns."""
    return np.array(
        [
            colorsys.hsv_to_rgb(
                (0.08 + part * 0.618034) % 1.0, 0.65 if part % 2 else 0.95, 0.6 if part % 3 == 1 else 0.9
            )
            for part in range(count)
        ]
    ).reshape(-1, 3)
