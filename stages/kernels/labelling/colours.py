"""Colours of parts that stay apart for every eye: normal sight, and the two common kinds of colour blindness."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.labelling.matching import match_parts

STEPS = 17  # of each channel, of which candidates are made
LIGHTNESS = (0.45, 0.85)  # OKLab; between these a colour shows on white and on black
CHROMA = (0.06, 0.19)  # neither grey nor glaring
NORMAL_SIGHT = 0.6  # differences count for less there, as most are larger: hues that most eyes tell apart come first
FIRST = (0.0, 0.45, 0.70)  # blue, as seen alike by nearly all

# Linear RGB to the OKLab space of perceived colour (B. Ottosson, 2020), in which distances are differences seen
LMS_RGB = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
LAB_LMS = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
# Linear RGB to what is seen without one kind of cones (Machado, Oliveira and Fernandes 2009, severity 1)
SEEN = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}


def distinct_colours(count: int) -> Float64[np.ndarray, "count 3"]:
    """sRGB colours in 0..1, each as far as can be from those before it for whoever tells them apart worst.

    More colours begin with the same ones.
    """
    candidates, lab = _candidates()
    chosen: list[int] = [int(np.linalg.norm(candidates - FIRST, axis=1).argmin())]
    distance = np.full(len(candidates), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(lab - lab[:, chosen[-1:]], axis=-1).min(axis=0))
        chosen.append(int(distance.argmax()))
    colours: np.ndarray = candidates[chosen[:count]]
    return colours


def colours_of_true_parts(
    labels: Int64[np.ndarray, "points"], labels_true: Int64[np.ndarray, "points"], true_parts: int
) -> Float64[np.ndarray, "true_parts 3"]:
    """The colour of each true part: that of the predicted part that it is matched to, or one of its own.

    Points with a negative true label belong to no part.
    """
    matched = match_parts(labels, labels_true)
    own = int(labels.max()) + 1 + np.arange(true_parts)
    colour_of = [matched.get(part, int(own[part])) for part in range(true_parts)]
    return distinct_colours(max(colour_of, default=-1) + 1)[np.array(colour_of, dtype=np.int64)]


def hexadecimal(colour: Float64[np.ndarray, "3"]) -> str:
    """A colour as HTML writes it."""
    return "#" + "".join(f"{round(255 * value):02x}" for value in colour.tolist())


def seen_difference(colours: Float64[np.ndarray, "count 3"]) -> Float64[np.ndarray, "count count"]:
    """The difference of each two colours (OKLab) for whoever sees it worst: about 0.02 is just noticed side by side."""
    lab = np.stack([oklab(colours, matrix) for matrix in SEEN.values()])
    return np.linalg.norm(lab[:, :, None] - lab[:, None], axis=-1).min(axis=0)


def oklab(
    colours: Float64[np.ndarray, "*batch 3"], seen: Float64[np.ndarray, "3 3"] = SEEN["normal"]
) -> Float64[np.ndarray, "*batch 3"]:
    """sRGB in 0..1 to lightness in 0..1 and two axes of hue, after what an eye loses by `seen`."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return np.cbrt(np.clip(linear @ seen.T, 0, 1) @ LMS_RGB.T) @ LAB_LMS.T


@cache
def _candidates() -> tuple[Float64[np.ndarray, "candidates 3"], Float64[np.ndarray, "eyes candidates 3"]]:
    """Colours that are neither too light nor too dark nor grey, and how each eye sees them."""
    levels = np.linspace(0, 1, STEPS)
    colours = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    lightness, *hue = oklab(colours).T
    chroma = np.hypot(*hue)
    fit = (lightness > LIGHTNESS[0]) & (lightness < LIGHTNESS[1]) & (chroma > CHROMA[0]) & (chroma < CHROMA[1])
    colours = colours[fit]
    weights = np.array([NORMAL_SIGHT, 1.0, 1.0])[:, None, None]
    return colours, weights * np.stack([oklab(colours, matrix) for matrix in SEEN.values()])
