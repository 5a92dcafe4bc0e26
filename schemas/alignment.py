"""What the alignment stage writes."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float64
from pydantic import Field

from schemas.artifact import Artifact, Rigid, Unit, Within


class Alignment(Artifact):
    """Where each frame lies in common coordinates, in which the object's largest body stands still.

    `own_frames` says whether the frames have coordinates of their own. If not, all transforms are the identity.
    """

    own_frames: bool
    upright: bool = Field(description="whether all frames have the same vertical, but for some degrees: z")
    Ts_common_frame: Annotated[Float64[np.ndarray, "frames 4 4"], Unit("normalised"), Rigid()]
    shares: Annotated[Float64[np.ndarray, "frames"], Unit("share"), Within(0, 1)] = Field(
        description="share of a frame and of the reference frame that lie on each other in common coordinates"
    )
