"""A relaxed model seen from another canonical frame: the parts and motions are the same, so nothing is fitted anew."""

from __future__ import annotations

import numpy as np

from schemas.relaxed import RelaxedModel
from schemas.sequence import PointSequence
from stages.kernels.nearest import KDTree, nearest
from stages.kernels.registration import move_points


def carry_over(model: RelaxedModel, sequence: PointSequence, canonical_frame: int) -> RelaxedModel:
    """The model with `canonical_frame` as its canonical one.

    Each of that frame's points gets the label of the nearest point that the model moves there; parts that no point
    there shows are dropped.
    """
    frames = sequence.frames()
    Ts = model.Ts_frame_canonical
    posed = move_points(Ts[canonical_frame, model.labels], frames[model.canonical_frame])
    found = model.labels[nearest(KDTree(posed), frames[canonical_frame])[1]]
    used, labels = np.unique(found, return_inverse=True)
    return model.replace(
        canonical_frame=canonical_frame,
        labels=labels.astype(np.int64),
        Ts_frame_canonical=np.ascontiguousarray((Ts @ np.linalg.inv(Ts[canonical_frame]))[:, used]),
    )
