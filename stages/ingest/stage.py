"""Ingest: convert files or a data set to a normalised sequence of frames with known scale and centre."""

from __future__ import annotations

import numpy as np

from schemas.config import IngestConfig
from schemas.sequence import IngestedSequence
from stages.ingest.sources import Source
from stages.support.progress import Progress, silent


def compute_ingest(
    source: Source, config: IngestConfig, rng: np.random.Generator, progress: Progress = silent
) -> IngestedSequence:
    """Load the sequence of a source, in the normalised frame. Raises InputError if it cannot be used."""
    progress(0, 1)
    sequence = source.load(config, rng)
    progress(1, 1)
    return sequence
