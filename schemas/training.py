"""The log of a training run, log.jsonl: a line a step, and a line a measurement."""

from __future__ import annotations

from typing import Literal

from schemas.artifact import Schema


class Step(Schema):
    """One step: the batch's loss, the rate it was learned with, and the seconds since training began or went on."""

    kind: Literal["step"] = "step"
    step: int
    loss: float
    learning_rate: float
    seconds: float


class Measurement(Schema):
    """The network on the validation pairs after a step.

    `loss` is the cross-entropy, `right` the share of points whose best match lies within 2 % of the diagonal of the
    true place, `mutual` the share of points that are their best match's best match, `mutual_right` that of right ones
    among these.
    """

    kind: Literal["measurement"] = "measurement"
    step: int
    loss: float
    right: float
    mutual: float
    mutual_right: float
    seconds: float
