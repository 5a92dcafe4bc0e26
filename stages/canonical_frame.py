"""Choice of the canonical frame among candidates: the lowest energy (A.5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from schemas.config import CanonicalFrameConfig, FinalFitConfig
from schemas.errors import InputError
from schemas.kinematic import Candidate, CanonicalChoice, KinematicModel
from schemas.sequence import PointSequence
from stages.final_fit.shared_energy import shared_energies

UNUSUAL = 4.0  # times as many points make half the spacing


def candidate_frames(point_counts: Sequence[int], config: CanonicalFrameConfig) -> tuple[int, ...]:
    """The frames to try: the configured ones, or the middle frame and its neighbours, nearest first.

    `point_counts` are those of all frames. Frames with `UNUSUAL` times the median count of points or more, or as much
    fewer, are not tried: most points of a far denser frame lie near none of the others', and a far sparser one shows
    parts by a few points. Which frame has which rank does not depend on how many are asked for; where there are fewer
    frames than candidates, some are tried twice. Raises InputError for a configured frame that the sequence does not
    have.
    """
    frame_count = len(point_counts)
    for frame in config.frames:
        if not 0 <= frame < frame_count:
            raise InputError(f"canonical_frame.frames: found {frame}, expected 0..{frame_count - 1}; correct it")
    if config.frames:
        return config.frames
    middle = frame_count // 2
    usual = float(np.median(point_counts))
    alike = [t for t, count in enumerate(point_counts) if usual / UNUSUAL < count < usual * UNUSUAL]
    nearest_first = sorted(alike or range(frame_count), key=lambda frame: (abs(frame - middle), frame))
    return tuple(nearest_first[rank % len(nearest_first)] for rank in range(config.candidates))


def choose(
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
