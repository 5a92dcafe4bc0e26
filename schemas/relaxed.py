"""The artifact of the relaxed fit of one candidate canonical frame."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from jaxtyping import Float64, Int64
from pydantic import Field, model_validator

from schemas.artifact import Artifact, Rigid, Unit, Within

RECONSTRUCTION_ENERGIES = ("E_recons", "E_CD", "E_EMD", "E_flow")  # the whole and its terms (Eq. 5)


class RelaxedModel(Artifact):
    """Part labels on the canonical frame and one free rigid motion per part and frame (Eq. 5).

    At least one point has each of the labels 0..parts-1.
    """

    canonical_frame: Annotated[int, Within(0, "frames")]
    labels: Annotated[Int64[np.ndarray, "points"], Unit("index"), Within(0, "parts")]
    Ts_frame_canonical: Annotated[Float64[np.ndarray, "frames parts 4 4"], Unit("normalised"), Rigid()]
    energy_history: Annotated[Float64[np.ndarray, "records energies"], Unit("normalised")] = Field(
        description="the solver's energies over the run; a column for each of `energy_names`"
    )
    energy_names: tuple[str, ...] = RECONSTRUCTION_ENERGIES
    solver: str
    iterations: int = Field(ge=0)

    @model_validator(mode="after")
    def _check_energies(self) -> Self:
        if self.energy_history.shape[1] != len(self.energy_names):
            raise ValueError(
                f"RelaxedModel.energy_history: found {self.energy_history.shape[1]} columns, expected one for each of "
                f"{', '.join(self.energy_names)}; give energy_names to match"
            )
        return self

    @model_validator(mode="after")
    def _check_labels(self) -> Self:
        parts = self.Ts_frame_canonical.shape[1]
        used = np.unique(self.labels)
        if not np.array_equal(used, np.arange(parts)):
            raise ValueError(
                f"RelaxedModel.labels: found {used.tolist()}, expected every part 0..{parts - 1} to have points"
            )
        return self
