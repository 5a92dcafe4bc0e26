"""Whether verdicts and spreads are right: `python benchmarks/verdict.py WORKDIR ... [--models]`.

It reads what `reart run` left of sequences with ground truth, and prints a line for each data set:

- of the wrong models (a wrong tree, or an adjusted Rand index below 0.7) and of the good ones (at least 0.9, and the
  right tree), how many there are and which share is flagged: its verdict is not "good";
- of the axes of all matched joints, the share whose direction and place are within one and within two spreads of the
  true ones, and their median spread. 68 % and 95 % are meant.

`--models` prints what each verdict rests on as well, to choose thresholds by. A sequence with several evaluations
counts by the newest. Verdicts of an older edition are made anew by the `reart run` that made the models.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.store import artifacts
from schemas.assessment import Assessment
from schemas.kinematic import CONFIDENCES, CanonicalChoice
from schemas.metrics import JointMetrics, Metrics

GOOD_ARI, WRONG_ARI = 0.9, 0.7


@dataclass(frozen=True)
class Judged:
    """A model with its ground truth and the verdict on it."""

    dataset: str
    sequence: str
    metrics: Metrics
    evaluation: Path

    @property
    def wrong(self) -> bool:
        return bool(self.metrics.tree_edit_distance) or (self.metrics.ari or 0.0) < WRONG_ARI

    @property
    def good(self) -> bool:
        return not self.metrics.tree_edit_distance and (self.metrics.ari or 0.0) >= GOOD_ARI

    @property
    def flagged(self) -> bool:
        return self.metrics.trust != "good"


def main(words: list[str] | None = None) -> int:
    """Print the tables. The exit code is 2 where no workdir holds a verdict that can be judged."""
    parser = argparse.ArgumentParser(description="Whether verdicts and spreads are right.")
    parser.add_argument("workdirs", nargs="+", type=Path, metavar="WORKDIR")
    parser.add_argument("--models", action="store_true", help="print a line for each model too")
    arguments = parser.parse_args(words)
    models = [model for workdir in arguments.workdirs for model in judged_models(workdir)]
    if not models:
        where = ", ".join(map(str, arguments.workdirs))
        print(f"error: {where}: found no verdict with ground truth, expected what `reart run` left", file=sys.stderr)
        return 2
    if arguments.models:
        for model in models:
            print(model_line(model))
        print()
    for name in (*sorted({model.dataset for model in models}), ""):
        of_set = [model for model in models if name in ("", model.dataset)]
        print(f"{name or 'all'}: {verdict_line(of_set)}")
        joints = [joint for model in of_set for joint in model.metrics.joints]
        for what, error, spread in (
            ("directions", "axis_angle_deg", "direction_spread_deg"),
            ("places", "place_percent", "place_spread_percent"),
        ):
            print(f"  {what}: {spread_line(joints, error, spread)}")
    return 0


def judged_models(workdir: Path) -> list[Judged]:
    """The newest evaluation of every sequence that has a verdict and true parts."""
    newest: dict[tuple[str, str], Path] = {}
    found = workdir.glob("*/*/evaluation-*/manifest.json")
    for manifest in sorted(found, key=lambda path: path.stat().st_mtime_ns):
        newest[manifest.parts[-4], manifest.parts[-3]] = manifest.parent
    models = [
        Judged(dataset, sequence, artifacts.read(directory, Metrics), directory)
        for (dataset, sequence), directory in sorted(newest.items())
        if "trust" in artifacts.read_manifest(directory).payload
    ]
    return [model for model in models if model.metrics.trust is not None and model.metrics.ari is not None]


def verdict_line(models: Sequence[Judged]) -> str:
    """How many models are wrong and good, and which share of each is flagged."""
    parts = [f"{len(models)} models"]
    for name in ("wrong", "good"):
        flags = [model.flagged for model in models if getattr(model, name)]
        parts.append(f"{len(flags)} {name}" + (f", {np.mean(flags):.0%} flagged" if flags else ""))
    return "; ".join(parts)


def spread_line(joints: Iterable[JointMetrics], error: str, spread: str) -> str:
    """Which share of errors is within one and two spreads, and their medians."""
    pairs = [(getattr(joint, error), getattr(joint, spread)) for joint in joints]
    known = np.array([pair for pair in pairs if None not in pair], dtype=np.float64)
    if not len(known):
        return "none"
    errors, spreads = known.T
    within = [float(np.mean(errors <= times * spreads)) for times in (1, 2)]
    median_error, median_spread = np.median(known, axis=0)
    return (
        f"{len(known)}, {within[0]:.0%} within one spread, {within[1]:.0%} within two; "
        f"median error {median_error:.2f}, median spread {median_spread:.2f}"
    )


def model_line(model: Judged) -> str:
    """What the verdict on a model rests on."""
    folder = model.evaluation.parent
    upstream = artifacts.read_manifest(model.evaluation).upstream
    evidence = artifacts.read(folder / f"assessment-{upstream['assessment']}", Assessment).evidence
    chosen = artifacts.read(folder / f"canonical_frame-{upstream['canonical_frame']}", CanonicalChoice).model
    sure = chosen.confidence.min(axis=0, initial=1.0) if chosen.confidence is not None else np.ones(len(CONFIDENCES))
    metrics, kind = model.metrics, "wrong" if model.wrong else "good" if model.good else "-"
    return (
        f"{model.dataset} {model.sequence}: {kind} {metrics.trust}; parts {metrics.parts_found}/{metrics.parts_true}, "
        f"ARI {metrics.ari:.2f}, TED {metrics.tree_edit_distance}; firmness {evidence.firmness.min(initial=1.0):.2f}, "
        f"unexplained {evidence.unexplained.max():.3f}, excess {evidence.excess.max():.2f}, "
        + ", ".join(f"{name} {value:.2f}" for name, value in zip(CONFIDENCES, sure, strict=True))
    )


if __name__ == "__main__":
    sys.exit(main())
