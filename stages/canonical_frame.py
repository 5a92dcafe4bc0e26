"""Choice of the canonical frame among candidates: the lowest E_project + E_group (A.5)."""

from __future__ import annotations

from collections.abc import Sequence

from schemas.config import CanonicalFrameConfig
from schemas.errors import InputError
from schemas.kinematic import Candidate, CanonicalChoice, KinematicModel


def candidate_frames(frame_count: int, config: CanonicalFrameConfig) -> tuple[int, ...]:
    """The frames to try: the configured ones, or the middle frame and its neighbours, nearest first.

    Which frame has which rank does not depend on how many are asked for; a sequence with fewer frames than
    candidates has some tried twice. Raises InputError for a configured frame that the sequence does not have.
    """
    for frame in config.frames:
        if not 0 <= frame < frame_count:
            raise InputError(f"canonical_frame.frames: found {frame}, expected 0..{frame_count - 1}; correct it")
    if config.frames:
        return config.frames
    middle = frame_count // 2
    nearest_first = sorted(range(frame_count), key=lambda frame: (abs(frame - middle), frame))
    return tuple(nearest_first[rank % frame_count] for rank in range(config.candidates))


def choose(models: Sequence[KinematicModel]) -> CanonicalChoice:
    """The candidate with the lowest E_project + E_group, and all candidates' energies.

    Of equal candidates the first wins. Raises ValueError when there is none.
    """
    candidates = tuple(
        Candidate(
            frame=model.canonical_frame,
            parts=model.part_count,
            e_project=model.energies["E_project"],
            e_group=model.energies["E_group"],
        )
        for model in models
    )
    if not candidates:
        raise ValueError("canonical frame: found no candidate, expected at least one")
    best = min(range(len(candidates)), key=lambda i: candidates[i].e_project + candidates[i].e_group)
    return CanonicalChoice(candidates=candidates, model=models[best])
