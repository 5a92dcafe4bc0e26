"""A relaxed model seen from another canonical frame: the parts and motions are the same, so nothing is fitted anew."""

from __future__ import annotations

import numpy as np

from schemas.relaxed import RelaxedModel
from schemas.sequence import PointSequence
from stages.kernels.alignment.carry_over import seen_from


def carry_over(model: RelaxedModel, sequence: PointSequence, canonical_frame: int) -> RelaxedModel:
    """The model with `canonical_frame` as its canonical one; parts that no point there shows are dropped."""
    frames = sequence.frames()
    found, Ts = seen_from(
        canonical_frame,
        frames[canonical_frame],
        frames[model.canonical_frame],
        model.labels,
        model.Ts_frame_canonical,
    )
    used, labels = np.unique(found, return_inverse=True)
    return model.replace(
        canonical_frame=canonical_frame,
        labels=labels.astype(np.int64),
        Ts_frame_canonical=np.ascontiguousarray(Ts[:, used]),
    )
