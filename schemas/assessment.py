"""How exactly a model's joints are known, and how far the model can be trusted."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float64
from pydantic import Field

from schemas.artifact import Artifact, Schema, Unit, Within

Trust = Literal["good", "doubtful", "poor"]


class Spread(Schema):
    """How exactly a joint's axis is known: a standard error, within which 68 % of true ones are meant to lie.

    `direction` is in radians; None for a joint without an axis. `place` is the distance of the true axis, or centre,
    from the joint's point; None for a prismatic joint, which may be anywhere. Lengths are in the unit of what the
    spread belongs to.
    """

    direction: float | None = Field(default=None, ge=0)
    place: float | None = Field(default=None, ge=0)


class Verdict(Schema):
    """How far a model can be trusted, in one word and in sentences, the weightiest first."""

    trust: Trust
    reasons: tuple[str, ...]


class Evidence(Artifact):
    """What a verdict rests on.

    `excess` is what the posed model leaves of each frame, over what two clouds of one surface leave of each other by
    their sampling and noise alone. `unexplained` is the share of each frame's points that lie off the posed model. In
    the canonical frame they are 1 and 0. `firmness` is, for each part, the adjusted Rand index between the model's
    labels and those in which this part has all points that it explains about as well as the part that has them. That of
    all labels is 1 less what each part's falls short of 1. `open_share` is the share of the points that any part takes
    over so.
    """

    excess: Annotated[Float64[np.ndarray, "frames"], Unit("1"), Within(0, 1e15)]
    unexplained: Annotated[Float64[np.ndarray, "frames"], Unit("1"), Within(0, 1)]
    firmness: Annotated[Float64[np.ndarray, "parts"], Unit("1"), Within(-1, 1)]
    open_share: float = Field(ge=0, le=1)


class Assessment(Artifact):
    """The spreads of a model's joints at their points, and the verdict on the model. Lengths are normalised."""

    spreads: tuple[Spread, ...]
    evidence: Evidence
    verdict: Verdict
