"""The log of a training run, log.jsonl: one line for each step and each measurement."""

from __future__ import annotations

from typing import Literal

from schemas.artifact import Schema


class Step(Schema):
    """One step: the batch's loss, the learning rate, and the seconds since training began or resumed."""

    kind: Literal["step"] = "step"
    step: int
    loss: float
    learning_rate: float
    seconds: float


class Measurement(Schema):
    """The network's performance on the validation pairs after a step.

    `loss` is the cross-entropy. `right` is the share of points whose best match lies within 2 % of the diagonal of the
    true place. `mutual` is the share of points with a mutual best match, and `mutual_right` the share of right matches
    among these.
    """

    kind: Literal["measurement"] = "measurement"
    step: int
    loss: float
    right: float
    mutual: float
    mutual_right: float
    seconds: float
