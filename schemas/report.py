"""The artifact of the report stage, beside report.html and report.png: the model's residuals."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float64
from pydantic import Field

from schemas.artifact import Artifact, Unit, Within


class Report(Artifact):
    """Residuals of every part in every frame: RMS nearest distances between model and frame."""

    residuals: Annotated[Float64[np.ndarray, "frames parts"], Unit("% of the diagonal"), Within(0, 1e15)]
    sampling: float = Field(description="residual of a perfect model, due to independent sampling, %")
