"""From frames as read to an ingested sequence: chosen, cleaned up and normalised, and the truth with them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

import numpy as np

from schemas.config import IngestConfig
from schemas.sequence import IngestedSequence, LengthUnit
from stages.ingest.cleaning import clean
from stages.ingest.normalise import normalise, normalise_truth
from stages.ingest.readers import Frame, check_every
from stages.ingest.truth import RawTruth

_log = logging.getLogger("rearticulate.ingest")


def assembled(
    frames: Sequence[Frame],
    truth: Callable[[], RawTruth] | None,
    config: IngestConfig,
    units: LengthUnit,
    rng: np.random.Generator,
) -> IngestedSequence:
    """Clean the frames up and normalise them, and their truth with them.

    The truth is asked for last, so that what is wrong with a frame is told first.
    """
    cleaned = clean(frames, config, rng)
    for remark in cleaned.remarks():
        _log.info(remark)
    sequence = normalise(cleaned.frames, config, units)
    sequence = sequence.replace(cleaned=cleaned.taken, remarks=cleaned.remarks())
    if truth is None:
        return IngestedSequence(sequence=sequence)
    kept_truth = truth().only(cleaned.kept)
    return IngestedSequence(sequence=sequence, truth=normalise_truth(kept_truth, cleaned.frames, sequence))


def every_frame(frames: Sequence[Frame], step: int) -> Sequence[Frame]:
    """Every `step`-th frame, from the first on. Raises InputError if that leaves only one of several."""
    check_every(len(frames), step)
    return frames[::step]
