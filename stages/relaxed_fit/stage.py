"""The relaxed fit: parts on the canonical frame and a free rigid motion per part and frame (Eq. 5).

A solver is a function `(sequence, flow, canonical_frame, config, rng, progress) -> RelaxedModel`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from schemas.config import RelaxedFitConfig
from schemas.flow import Flow
from schemas.relaxed import RelaxedModel
from schemas.sequence import PointSequence
from stages.relaxed_fit.alternating import solve_alternating
from stages.relaxed_fit.gumbel import solve_gumbel
from stages.support.progress import Progress, silent
from stages.support.registry import blaming, resolve

Solver = Callable[[PointSequence, Flow, int, RelaxedFitConfig, np.random.Generator, Progress], RelaxedModel]

SOLVERS: dict[str, Solver] = {"gumbel": solve_gumbel, "alternating": solve_alternating}


def compute_relaxed_fit(
    sequence: PointSequence,
    flow: Flow,
    canonical_frame: int,
    config: RelaxedFitConfig,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> RelaxedModel:
    """Fit the relaxed model of one candidate canonical frame, by the solver that the configuration names.

    Raises InputError for an unknown solver, ValueError where a user's own returns a model of another shape.
    """
    solver = resolve("relaxed_fit.solver", config.solver, SOLVERS)
    with blaming("relaxed_fit.solver", config.solver):
        model = solver(sequence, flow, canonical_frame, config, rng, progress)
    if not isinstance(model, RelaxedModel):
        raise ValueError(
            f"relaxed_fit.solver {config.solver!r}: found a {type(model).__name__}, expected a RelaxedModel"
        )
    points = int(sequence.point_counts[canonical_frame])
    if model.canonical_frame != canonical_frame:
        raise ValueError(
            f"relaxed_fit.solver {config.solver!r}: found canonical frame {model.canonical_frame}, "
            f"expected {canonical_frame}"
        )
    if len(model.labels) != points or len(model.Ts_frame_canonical) != sequence.frame_count:
        raise ValueError(
            f"relaxed_fit.solver {config.solver!r}: found {len(model.labels)} labels and "
            f"{len(model.Ts_frame_canonical)} frames, expected {points} and {sequence.frame_count}"
        )
    return model
