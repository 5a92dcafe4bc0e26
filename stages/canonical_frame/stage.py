"""Choice of the canonical frame among candidates: the lowest energy (A.5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from schemas.config import FinalFitConfig
from schemas.kinematic import Candidate, CanonicalChoice, KinematicModel
from schemas.sequence import PointSequence
from stages.final_fit.shared_energy import shared_energies


def compute_canonical_frame(
    models: Sequence[KinematicModel],
    sequence: PointSequence,
    by: Literal["fit", "project"],
    final_fit: FinalFitConfig,
) -> CanonicalChoice:
    """The candidate with the lowest energy, and all candidates' energies.

    The energy is E_fit, what the final fit leaves of the frames and pays for parts, on clouds that all candidates share
    (`fit`), or E_project + E_group as published (`project`). Of equal candidates the first wins. Raises ValueError when
    there is none.
    """
    if not models:
        raise ValueError("canonical frame: found no candidate, expected at least one")
    candidates = tuple(
        Candidate(
            frame=model.canonical_frame,
            parts=model.part_count,
            e_project=model.energies["E_project"],
            e_group=model.energies["E_group"],
            e_fit=e_fit,
        )
        for model, e_fit in zip(models, shared_energies(models, sequence, final_fit), strict=True)
    )
    energies = [one.e_fit if by == "fit" else one.e_project + one.e_group for one in candidates]
    return CanonicalChoice(candidates=candidates, model=models[energies.index(min(energies))])
