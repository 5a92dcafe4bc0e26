"""E_recons (Eq. 5) of the two solvers on one sequence: `python benchmarks/energy.py FRAMES [--iterations N]`.

Both get the same flow and fit the same canonical frame; the energy of their relaxed models is then measured in the same
way, on 2,048 points a frame. `gumbel` starts from still parts, at the published rates, as in preset `paper`.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from run import facts

from pipeline.configuration.presets import load_config
from schemas.flow import Flow
from schemas.relaxed import RECONSTRUCTION_ENERGIES, RelaxedModel
from schemas.sequence import PointSequence
from stages.flow.stage import compute_flow
from stages.ingest.file_source import file_source
from stages.ingest.stage import compute_ingest
from stages.kernels.motion.rigid_motion import move_points
from stages.relaxed_fit.reconstruction_energy import EnergyTerms, ReconstructionEnergy
from stages.relaxed_fit.stage import compute_relaxed_fit
from stages.support.progress import silent


def main(words: list[str] | None = None) -> int:
    """Fit by both solvers and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", type=Path, help="a folder of frames, or one .npy/.npz")
    parser.add_argument("--iterations", type=int, default=15000, help="of the solver gumbel")
    arguments = parser.parse_args(words)
    rng = np.random.default_rng(0)
    config = load_config(["scans", "paper"])
    sequence = compute_ingest(file_source(arguments.frames), config.ingest, rng, silent).sequence
    flow = compute_flow(sequence, config.flow, rng)
    gumbel = config.relaxed_fit.gumbel.model_copy(update={"iterations": arguments.iterations})
    for solver in ("alternating", "gumbel"):
        settings = config.relaxed_fit.model_copy(update={"solver": solver, "gumbel": gumbel})
        clock = time.perf_counter()
        model = compute_relaxed_fit(sequence, flow, sequence.frame_count // 2, settings, np.random.default_rng(0))
        seconds = time.perf_counter() - clock
        terms = energy(model, sequence, flow).row()
        named = zip(RECONSTRUCTION_ENERGIES, terms, strict=True)
        figures = "  ".join(f"{name} {value:.5f}" for name, value in named)
        print(f"{solver:12s} {model.Ts_frame_canonical.shape[1]:3d} parts  {figures}  {seconds:.1f} s", flush=True)
    print(f"{facts()} Seed 0.")
    return 0


def energy(model: RelaxedModel, sequence: PointSequence, flow: Flow) -> EnergyTerms:
    """E_recons of a relaxed model, with the weights of the final fit."""
    weights = load_config(["scans"]).final_fit.energy
    measured = ReconstructionEnergy(sequence, flow, model.canonical_frame, weights, 2048, 1)
    return measured(move_points(model.Ts_frame_canonical[:, model.labels[measured.index]], measured.p_canonical), 0)


if __name__ == "__main__":
    sys.exit(main())
