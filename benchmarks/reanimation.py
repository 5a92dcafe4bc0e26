"""How much of the reanimation error is the model's: `python benchmarks/reanimation.py WORKDIR [--only SEQUENCE ...]`.

WORKDIR is a finished run's working directory, or one data set's folder in it. Three models of every sequence are
brought to its unseen states by the evaluation's own procedure, given the same points: one of each true part, drawn
several times.

- *fitted*: the run's model.
- *exact*: the true parts and the true joints. What it leaves, the given points leave open.
- *sampled*: the true parts, tree and joint types, with axes and states fitted to the sampled frames as in the final
  fit. This is the true model's own sampling floor: what the frames tell of the joints once all else is known.

*Right points* asks the same where the parts are right: points that carry their true part's label are given, and count.
The record goes to results/reanimation-DATE.json and .md.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64, Int64
from pydantic import Field
from run import FOLDER, Machine, commit, machine

from pipeline.results.report_tables import Cell, Row, Table, to_markdown
from pipeline.run.task import package_versions
from pipeline.store import artifacts
from pipeline.store.keys import canonical_json
from schemas.artifact import Schema
from schemas.config import FinalFitConfig, PipelineConfig
from schemas.errors import InputError
from schemas.kinematic import CanonicalChoice, KinematicModel
from schemas.metrics import Metrics
from schemas.sequence import IngestedSequence
from stages.evaluation.stage import reanimation_distances
from stages.final_fit.working import Fit, chain_of, root_moves, to_model, working_frames
from stages.kernels.labelling.matching import match_parts

DRAWS = 5  # of the given points; the first is the evaluation's own
OVERLAP = 0.5  # least share of a part's points, found and true together, that are common to both where it is right


class Reanimation(Schema):
    """Errors of one sequence, in % of the diagonal: means over points, unseen states and draws of the given points."""

    sequence: str
    parts_found: int
    parts_true: int
    tree_edit_distance: int | None
    parts_right: bool = Field(description="the tree is the true one, and every part shares most of its points")
    right_share: float = Field(description="of the points that carry their true part's label")
    exact: float
    sampled: float
    fitted: float
    sampled_on_right: float
    fitted_on_right: float

    @property
    def ratio(self) -> float:
        return self.fitted / self.sampled

    @property
    def ratio_on_right(self) -> float:
        return self.fitted_on_right / self.sampled_on_right


class Record(Schema):
    """benchmarks/results/reanimation-DATE.json."""

    date: datetime
    commit: str
    machine: Machine
    packages: dict[str, str]
    draws: int
    sequences: tuple[Reanimation, ...]


def main(words: list[str] | None = None) -> int:
    """Measure all sequences. The exit code is 2 where there is none that can be measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("workdir", type=Path, help="a finished run's working directory, or a data set's folder in it")
    parser.add_argument("--only", nargs="+", metavar="SEQUENCE", help="these sequences only")
    parser.add_argument("--draws", type=int, default=DRAWS, help=f"of the given points; default: {DRAWS}")
    parser.add_argument("--results", type=Path, default=FOLDER / "results", help="where the record is kept")
    arguments = parser.parse_args(words)
    found = [path for depth in ("*/", "*/*/") for path in arguments.workdir.glob(f"{depth}evaluation-*/manifest.json")]
    directories = [path.parent for path in sorted(found) if not arguments.only or path.parts[-3] in arguments.only]
    measured = []
    for artifact in directories:
        try:
            measured.append(measure(artifact, arguments.draws))
            print(f"{measured[-1].sequence}: {measured[-1].ratio:.2f} times the sampling floor", flush=True)
        except InputError as error:
            print(f"{artifact}: {error}; left out", file=sys.stderr)
    if not measured:
        print(
            f"error: {arguments.workdir}: found nothing to measure, expected a finished run with ground truth; "
            "check the path",
            file=sys.stderr,
        )
        return 2
    record = Record(
        date=datetime.now(UTC),
        commit=commit(),
        machine=machine(),
        packages=package_versions(),
        draws=arguments.draws,
        sequences=tuple(measured),
    )
    text = "\n".join([to_markdown(table(record)), to_markdown(summary(record))])
    path = arguments.results / f"reanimation-{record.date:%Y-%m-%d-%H%M}.json"
    path.write_text(record.model_dump_json(indent=1) + "\n")
    path.with_suffix(".md").write_text(text)
    print(f"\n{text}\nwritten: {path}, {path.with_suffix('.md')}")
    return 0


def measure(artifact: Path, draws: int) -> Reanimation:
    """One sequence, by its evaluation's artifact. Raises InputError where the truth lacks what this needs."""
    manifest = artifacts.read_manifest(artifact)
    upstream = {stage: artifact.with_name(f"{stage}-{key}") for stage, key in manifest.upstream.items()}
    ingested = artifacts.read(upstream["ingest"], IngestedSequence)
    fitted = artifacts.read(upstream["canonical_frame"], CanonicalChoice).model
    metrics = artifacts.read(artifact, Metrics)
    config = PipelineConfig.model_validate(manifest.config)
    exact = true_model(ingested, fitted.canonical_frame)
    sampled = fitted_to_frames(exact, ingested, config.final_fit)
    labels_true, truth = exact.labels, ingested.truth
    assert truth is not None  # or true_model would have refused
    p = ingested.sequence.frames()[fitted.canonical_frame]
    right = rightly_labelled(fitted.labels, labels_true)
    everywhere = np.ones_like(right)

    def error(model: KinematicModel, among: Bool[np.ndarray, "points"]) -> float:
        distances = [
            reanimation_distances(model, truth, labels_true, p, given, config.evaluation.reanimation_iterations)
            for given in target_points(labels_true, among, manifest.seed, draws)
        ]
        return 100 * float(np.mean([distance[:, among].mean() for distance in distances]))

    return Reanimation(
        sequence=manifest.sequence,
        parts_found=fitted.part_count,
        parts_true=exact.part_count,
        tree_edit_distance=metrics.tree_edit_distance,
        parts_right=metrics.tree_edit_distance == 0 and bool((overlaps(fitted.labels, labels_true) >= OVERLAP).all()),
        right_share=float(right.mean()),
        exact=error(exact, everywhere),
        sampled=error(sampled, everywhere),
        fitted=error(fitted, everywhere),
        sampled_on_right=error(sampled, right),
        fitted_on_right=error(fitted, right),
    )


def target_points(
    labels_true: Int64[np.ndarray, "points"], among: Bool[np.ndarray, "points"], seed: int, draws: int
) -> Iterable[Int64[np.ndarray, "given"]]:
    """One point of each true part, several times; of those in `among` where the part has any."""
    parts = [np.flatnonzero(labels_true == part) for part in np.unique(labels_true)]
    parts = [own[among[own]] if among[own].any() else own for own in parts]
    stage = zlib.crc32(canonical_json(["evaluation", {}]).encode())
    for draw in range(draws):
        rng = np.random.default_rng([seed, stage, *[draw][:draw]])  # the first as the task's own
        yield np.array([rng.choice(own) for own in parts])


def true_model(ingested: IngestedSequence, canonical_frame: int) -> KinematicModel:
    """The ground truth as a model. Raises InputError where it does not tell one joint for every part but the root."""
    truth = ingested.truth
    if truth is None or sorted(joint.child for joint in truth.joints) != np.flatnonzero(truth.parent >= 0).tolist():
        raise InputError("ground truth: found none with a joint for every part but the root, expected that")
    if any(joint.kind.size != 1 for joint in truth.joints) or np.count_nonzero(truth.parent < 0) != 1:
        raise InputError("ground truth: found spherical joints or several roots, expected one tree of other joints")
    if not ingested.of_object(canonical_frame).all():
        raise InputError("ground truth: found points of no part, expected a part for every point")
    T_canonical_first = truth.Ts_frame_first[canonical_frame]
    parent = np.array([joint.parent for joint in truth.joints], dtype=np.int64)
    R, t = T_canonical_first[parent, :3, :3], T_canonical_first[parent, :3, 3]
    states = np.array([joint.states for joint in truth.joints]).reshape(len(parent), -1).T
    return KinematicModel(
        canonical_frame=canonical_frame,
        root=int(np.flatnonzero(truth.parent < 0)[0]),
        labels=ingested.sequence.by_frame(truth.labels)[canonical_frame],
        Ts_frame_canonical=truth.Ts_frame_first @ np.linalg.inv(T_canonical_first),
        joint_parent=parent,
        joint_child=np.array([joint.child for joint in truth.joints], dtype=np.int64),
        joint_types=tuple(joint.type for joint in truth.joints),
        axis=rotated(R, [joint.axis for joint in truth.joints]),
        point=rotated(R, [joint.point for joint in truth.joints]) + t,
        states=states - states[canonical_frame],
        e_spatial=np.zeros(len(parent)),
        e_1dof=np.zeros(len(parent)),
        energies={},
    )


def rotated(R: Float64[np.ndarray, "joints 3 3"], vectors: list[tuple[float, float, float]]) -> np.ndarray:
    """Each vector by its own rotation."""
    return np.einsum("jab,jb->ja", R, np.array(vectors, dtype=np.float64).reshape(-1, 3))


def fitted_to_frames(exact: KinematicModel, ingested: IngestedSequence, config: FinalFitConfig) -> KinematicModel:
    """The true model with its axes, states and root motion fitted to the sampled frames from the truth on."""
    frames = working_frames(ingested.sequence, exact.canonical_frame, config)
    chain = chain_of(exact, root_moves(exact.Ts_frame_canonical[:, exact.root]))
    fit = frames.refine(Fit(chain, exact.labels[frames.index]), config.last_iterations)
    return to_model(exact, fit, frames).replace(labels=exact.labels)


def rightly_labelled(
    labels: Int64[np.ndarray, "points"], labels_true: Int64[np.ndarray, "points"]
) -> Bool[np.ndarray, "points"]:
    """Which points are of the part that was matched to their true one."""
    matched = match_parts(labels, labels_true)
    right: np.ndarray = (
        labels == np.array([matched.get(part, -1) for part in range(labels_true.max() + 1)])[labels_true]
    )
    return right


def overlaps(
    labels: Int64[np.ndarray, "points"], labels_true: Int64[np.ndarray, "points"]
) -> Float64[np.ndarray, "parts"]:
    """Of each true part that has points: the points common to it and the part matched to it, among those of either."""
    matched = match_parts(labels, labels_true)
    pairs = [(labels_true == part, labels == matched.get(int(part), -1)) for part in np.unique(labels_true)]
    return np.array([np.count_nonzero(true & own) / np.count_nonzero(true | own) for true, own in pairs])


def table(record: Record) -> Table:
    """A line a sequence."""
    columns = ("sequence", "parts", "TED", "parts right", "points right", "exact %", "sampled %", "fitted %", "ratio")
    columns += ("sampled %, right points", "fitted %, right points", "ratio, right points")
    rows = []
    for entry in record.sequences:
        ted = entry.tree_edit_distance
        cells = [f"{entry.parts_found} of {entry.parts_true}", "-" if ted is None else str(ted)]
        cells += ["yes" if entry.parts_right else "no", f"{entry.right_share:.2f}", f"{entry.exact:.4f}"]
        cells += [f"{entry.sampled:.3f}", f"{entry.fitted:.3f}", f"{entry.ratio:.1f}"]
        cells += [f"{entry.sampled_on_right:.3f}", f"{entry.fitted_on_right:.3f}", f"{entry.ratio_on_right:.1f}"]
        rows.append(Row(entry.sequence, tuple(map(Cell, cells))))
    return Table("Reanimation against the true model", columns, tuple(rows), words=True)


def summary(record: Record) -> Table:
    """Medians over all sequences, and over those whose tree or parts are right."""
    groups = {
        "all": record.sequences,
        "tree right (TED 0)": [entry for entry in record.sequences if entry.tree_edit_distance == 0],
        "parts right": [entry for entry in record.sequences if entry.parts_right],
    }
    columns = (
        "median over",
        "sequences",
        "sampled %",
        "fitted %",
        "ratio",
        "ratio, right points",
        "of these at most 1.5",
    )
    rows = []
    for name, entries in groups.items():
        if not entries:
            continue
        names = ("sampled", "fitted", "ratio", "ratio_on_right")
        medians = [float(np.median([getattr(entry, figure) for entry in entries])) for figure in names]
        cells = [
            str(len(entries)),
            *(f"{value:.3f}" for value in medians[:2]),
            *(f"{value:.2f}" for value in medians[2:]),
        ]
        cells.append(str(sum(entry.ratio_on_right <= 1.5 for entry in entries)))
        rows.append(Row(name, tuple(map(Cell, cells))))
    return Table("Medians", columns, tuple(rows), words=True)


if __name__ == "__main__":
    sys.exit(main())
