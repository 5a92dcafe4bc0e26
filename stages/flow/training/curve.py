"""The learning curve of a training, as a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schemas.training import Measurement, Step
from stages.support.pictures import Figure, picture_bytes

SMOOTHED = 50  # most steps that are averaged to one point of the loss curve


def curve_png(steps: Sequence[Step], measurements: Sequence[Measurement]) -> bytes:
    """Draw the loss, and the shares of right matches on validation pairs, by step."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    width = max(1, min(SMOOTHED, len(steps) // 20))
    loss = np.convolve([step.loss for step in steps], np.full(width, 1 / width), mode="valid")
    left.plot([step.step for step in steps][width - 1 :], loss, color="#0072b2", label="training")
    at = [measurement.step for measurement in measurements]
    left.plot(at, [measurement.loss for measurement in measurements], "o-", color="#d55e00", label="validation")
    left.set(xlabel="step", ylabel="cross-entropy")
    left.legend(frameon=False)
    for name, label, style in (
        ("right", "right, of all points", "o-"),
        ("mutual", "mutual matches, of all points", "s--"),
        ("mutual_right", "right, of mutual matches", "^-"),
    ):
        right.plot(at, [100 * getattr(measurement, name) for measurement in measurements], style, label=label)
    right.set(xlabel="step", ylabel="%", ylim=(0, 100), title="validation")
    right.legend(frameon=False)
    return picture_bytes(figure, "png", dpi=110)
