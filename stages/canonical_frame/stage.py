"""Choice of the canonical frame among candidates: the lowest energy (A.5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float64
from scipy.spatial import ConvexHull

from schemas.config import FEW_FRAMES, FinalFitConfig
from schemas.kinematic import Candidate, CanonicalChoice, KinematicModel
from schemas.sequence import PointSequence
from stages.final_fit.shared_energy import shared_energies
from stages.kernels.points.sampling import thinned

AS_GOOD = 1.01  # times the least E_fit: models so near it are told apart by other means
HULL_POINTS = 20_000  # that tell a cloud's hull


def compute_canonical_frame(
    models: Sequence[KinematicModel],
    sequence: PointSequence,
    by: Literal["fit", "project"],
    final_fit: FinalFitConfig,
) -> CanonicalChoice:
    """The candidate with the lowest energy, and all candidates' energies.

    The energy is E_fit, what the final fit leaves of the frames and pays for parts, on clouds that all candidates share
    (`fit`), or E_project + E_group as published (`project`). Of equal candidates the first wins. Of a few frames, which
    are states in no order, E_fit hardly tells some apart. Among those the fewest parts win, and of as many the most
    open frame: there parts touch least, so their ends show best. Raises ValueError when there is none.
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
    chosen = energies.index(min(energies))
    if by == "fit" and sequence.frame_count <= FEW_FRAMES:
        frames = sequence.frames()
        as_good = [k for k, energy in enumerate(energies) if energy <= AS_GOOD * energies[chosen]]
        chosen = max(as_good, key=lambda k: (-models[k].part_count, openness(frames[models[k].canonical_frame])))
    return CanonicalChoice(candidates=candidates, model=models[chosen])


def openness(p: Float64[np.ndarray, "points 3"]) -> float:
    """The volume of a cloud's convex hull."""
    p = p[thinned(len(p), HULL_POINTS)]
    return float(ConvexHull(p, qhull_options="QJ").volume)  # QJ: flat clouds have a hull, too
