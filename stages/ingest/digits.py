"""A warning for coordinates that were rounded too coarsely before or in the file."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from stages.ingest.formats.cloud import Points
from stages.kernels.points.quantisation import coarseness, quantisation_step

_log = logging.getLogger("rearticulate.ingest")

_LOOKED_AT = 10  # frames to check


def warn_of_lost_digits(names: Sequence[str], frames: Sequence[Points]) -> None:
    """Warn if at least half of the checked frames are coarse. The warning names the steps and the cloud's spacing."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, _LOOKED_AT).astype(int))
    found = {int(index): coarseness(frames[index]) for index in chosen}
    if np.median(list(found.values())) == 0:
        return
    worst = max(found, key=lambda index: found[index])
    steps = quantisation_step(frames[worst])
    _log.warning(
        "the coordinates have lost their digits: in %s they lie on steps of %s along x, y and z, "
        "with points about %.3g apart, so that shapes and motions are blurred; "
        "save them in double precision or with more decimals, or subtract one offset from all frames before",
        names[worst],
        ", ".join(f"{step:.3g}" for step in steps),
        max(steps.max() / found[worst], _size(frames[worst]) / (4 * np.sqrt(len(frames[worst])))),
    )


def _size(points: Points) -> float:
    """The cloud's diagonal. N points of a surface have a spacing of about diagonal / (4 sqrt(N))."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))
