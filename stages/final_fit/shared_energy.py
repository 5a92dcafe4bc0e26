"""Fits compared on the same clouds: what each leaves of the frames, whichever frame it has for its canonical one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schemas.config import FinalFitConfig
from schemas.kinematic import KinematicModel
from schemas.sequence import PointSequence
from stages.final_fit.working import working_frames
from stages.kernels.alignment.carry_over import seen_from


def shared_energies(models: Sequence[KinematicModel], sequence: PointSequence, config: FinalFitConfig) -> list[float]:
    """E_fit of each model, seen from every model's canonical frame in turn; the mean per point.

    A model's own E_fit holds the noise of its own canonical cloud, which differs more between frames than models do.
    """
    frames = sequence.frames()
    totals = np.zeros(len(models))
    references = sorted({model.canonical_frame for model in models})
    for reference in references:
        clouds = working_frames(sequence, reference, config, models=models)
        for index, model in enumerate(models):
            labels, Ts = seen_from(
                reference, clouds.p, frames[model.canonical_frame], model.labels, model.Ts_frame_canonical
            )
            cost = clouds.point_costs(labels, Ts).sum() + clouds.price(config.part_price) * model.part_count
            totals[index] += cost / len(labels)
    return (totals / len(references)).tolist()
