"""Ingest: files, or a dataset's own format, to a sequence of frames with scale and centre known."""

from __future__ import annotations

import numpy as np

from schemas.config import IngestConfig
from schemas.sequence import IngestedSequence
from stages.ingest.sources import Source
from stages.support.progress import Progress, silent


def compute_ingest(
    source: Source, config: IngestConfig, rng: np.random.Generator, progress: Progress = silent
) -> IngestedSequence:
    """The sequence that `source` stands for, in the normalised frame. Raises InputError where it cannot be used."""
    progress(0, 1)
    sequence = source.load(config, rng)
    progress(1, 1)
    return sequence
