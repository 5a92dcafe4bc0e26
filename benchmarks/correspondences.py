"""Estimators against the truth: `python benchmarks/correspondences.py --robots A,B --assets DIR [--objects DIR]`.

Robots (--robots, NAME/NAME.urdf in --assets or a package) and other objects (--objects, a folder of NAME/NAME.urdf)
are sampled while every revolute joint turns by 10, 30, 60 and 120 degrees from frame to frame, as far as its limits
allow and in directions that keep parts apart; prismatic joints slide by the same share of half their range as that
angle is of 90 degrees. Then with RoboArt's own motion: all frames, every second, every third, and in random order. The
first pairs of each are estimated, by each of --estimators.

Measured in each condition, over the points of its pairs, lengths in % of the diagonal: the share of source points that
have a match; the share of matches whose target lies within 2 % of where the source point really went; the mean error of
the flow interpolated to all source points; seconds a pair. The table and the record of all sequences go to
benchmarks/results/correspondences-DATE.md and .json.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from pydantic import ValidationError
from run import FOLDER, Machine, commit, machine

from pipeline.results.report_tables import Cell, Row, Table, to_markdown
from pipeline.run.task import package_versions
from schemas.artifact import Schema
from schemas.config import FlowConfig, RoboartConfig
from schemas.errors import InputError
from schemas.joints import REVOLUTE, JointKind
from stages.flow.stage import ESTIMATORS, Estimator, PairFlow
from stages.flow.trajectories import interpolate
from stages.ingest.roboart import build_from_urdf
from stages.ingest.roboart.descriptions import Description, own_descriptions, robot_description
from stages.ingest.truth import RawTruth
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree
from stages.kernels.points.normalisation import Normalisation
from stages.support.progress import silent
from stages.support.registry import resolve

STEPS = (10.0, 30.0, 60.0, 120.0)  # degrees a frame
RIGHT = 0.02  # a match is right within this distance, in diagonals
NEIGHBOURS = 3  # of the interpolation to all points
COLUMNS = ("estimator", "reached deg", "matched %", "right %", "EPE %", "s / pair")


class Measured(Schema):
    """One estimator on the pairs of one sequence under one condition; shares and lengths in %."""

    sequence: str
    condition: str
    estimator: str
    reached_degrees: float | None
    matched: float
    right: float | None
    epe: float
    seconds: float


class Record(Schema):
    """benchmarks/results/correspondences-DATE.json: one run."""

    date: datetime
    commit: str
    command: str
    machine: Machine
    packages: dict[str, str]
    measured: tuple[Measured, ...]


@dataclass(frozen=True)
class Condition:
    """How far joints move: `step_degrees` a frame, or as in RoboArt, of which every `stride`-th frame or `shuffled`."""

    name: str
    step_degrees: float | None = None
    stride: int = 1
    shuffled: bool = False


CONDITIONS = (
    *(Condition(f"{step:g} degrees", step_degrees=step) for step in STEPS),
    Condition("RoboArt, all frames"),
    Condition("RoboArt, every 2nd", stride=2),
    Condition("RoboArt, every 3rd", stride=3),
    Condition("RoboArt, shuffled", shuffled=True),
)


@dataclass(frozen=True)
class Posed:
    """Frames in the normalised frame, where each one's points really are in the next, and the mean turn of a joint."""

    frames: list[Float64[np.ndarray, "points 3"]]
    p_next: list[Float64[np.ndarray, "points 3"]]
    reached_degrees: float | None


def build(description: Description, condition: Condition, pairs: int, points: int, seed: int) -> Posed:
    """A sequence under a condition, with its truth. Raises InputError where the description cannot be used."""
    rng = np.random.default_rng(seed)
    frames = 10 if condition.step_degrees is None else pairs + 1
    config = RoboartConfig(points=points, novel_states=0, frames=frames)
    paths = description.urdf_path, description.mesh_dirs
    if condition.step_degrees is None:
        return posed(*build_from_urdf(*paths, config, rng)[:2], frame_order(condition, frames, rng)[: pairs + 1])
    p, truth, _ = build_from_urdf(*paths, config, rng, stepping(np.radians(condition.step_degrees)))
    return posed(p, truth, np.arange(frames))


def frame_order(condition: Condition, frames: int, rng: np.random.Generator) -> np.ndarray:
    """Which frames are kept, in which order."""
    return rng.permutation(frames) if condition.shuffled else np.arange(0, frames, condition.stride)


def stepping(step: float) -> Callable[..., np.ndarray]:
    """A draw of joint positions that differ by `step` radians from one to the next, as far as the limits allow."""

    def sweep(kind: JointKind, limits: np.ndarray, config: RoboartConfig, rng: np.random.Generator) -> np.ndarray:
        lower, upper = limits
        wanted = step if kind == REVOLUTE else (upper - lower) / 2 * step / (np.pi / 2)
        size = min(wanted, upper - lower)
        start = rng.uniform(0, max(upper - lower - size, 0))
        path = [rng.choice([lower + start, upper - start])]
        for _ in range(config.frames - 1):
            ends = [end for end in (path[-1] - size, path[-1] + size) if lower - 1e-9 <= end <= upper + 1e-9]
            path.append(rng.choice(ends) if ends else max((lower, upper), key=lambda end: abs(end - path[-1])))
        return np.array(path)

    return sweep


def posed(p: list[np.ndarray], truth: RawTruth, order: np.ndarray) -> Posed:
    """Some frames of a sequence in the normalised frame, in some order."""
    box = [Normalisation.of(points) for points in p]
    frame = Normalisation(np.median([b.centre for b in box], axis=0), float(np.median([b.scale for b in box])))
    Ts = frame.motions(truth.Ts_frame_first)
    frames = [frame.points(p[t]) for t in order]
    p_next = [
        move_points((Ts[after] @ np.linalg.inv(Ts[t]))[truth.labels[t]], points)
        for t, after, points in zip(order, order[1:], frames, strict=False)
    ]
    turns = [np.abs(np.diff(np.array(joint.states)[order])) for joint in truth.joints if joint.type == "revolute"]
    return Posed(frames, p_next, float(np.degrees(np.mean(turns))) if turns else None)


def measure(name: str, estimate: Estimator, config: FlowConfig, seed: int, condition: Condition, of: Posed) -> Measured:
    """What an estimator makes of a sequence; `name` is the sequence's."""
    clock = time.perf_counter()
    pairs = estimate(of.frames, config, np.random.default_rng(seed), silent)
    seconds = (time.perf_counter() - clock) / len(pairs)
    errors = [match_errors(pair, of.frames[k + 1], of.p_next[k]) for k, pair in enumerate(pairs)]
    flow_errors = [np.linalg.norm(flow_of_all(pair, p) + p - p_next, axis=1) for pair, p, p_next in _zip(pairs, of)]
    found = np.concatenate(errors)
    return Measured(
        sequence=name,
        condition=condition.name,
        estimator=config.estimator,
        reached_degrees=of.reached_degrees,
        matched=100 * len(found) / sum(map(len, of.p_next)),
        right=100 * float((found <= RIGHT).mean()) if len(found) else None,
        epe=100 * float(np.concatenate(flow_errors).mean()),
        seconds=seconds,
    )


def _zip(pairs: Sequence[PairFlow], of: Posed) -> zip[tuple[PairFlow, np.ndarray, np.ndarray]]:
    return zip(pairs, of.frames[:-1], of.p_next, strict=True)


def match_errors(pair: PairFlow, target: np.ndarray, p_next: np.ndarray) -> Float64[np.ndarray, "matches"]:
    """How far from its source point's true place each matched target lies."""
    return np.linalg.norm(target[pair.target_index] - p_next[pair.source_index], axis=1)


def flow_of_all(pair: PairFlow, p: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 3"]:
    """The flow interpolated to all source points; none without matches."""
    if len(pair.source_index) == 0:
        return np.zeros_like(p)
    return interpolate(KDTree(p[pair.source_index]), pair.flow, p, NEIGHBOURS)[0]


def tables(measured: Sequence[Measured], conditions: Sequence[str], estimators: Sequence[str]) -> list[Table]:
    """Means over the sequences by condition and estimator, and the share of right matches by sequence."""
    names = list(dict.fromkeys(m.sequence for m in measured))
    means, each = [], []
    for condition in conditions:
        for estimator in estimators:
            chosen = {m.sequence: m for m in measured if (m.condition, m.estimator) == (condition, estimator)}
            columns = ("reached_degrees", "matched", "right", "epe", "seconds")
            figures = [_mean([getattr(m, column) for m in chosen.values()]) for column in columns]
            means.append(Row(condition, (Cell(estimator), *map(_cell, figures, (1, 1, 1, 2, 2)))))
            right = [chosen[name].right if name in chosen else None for name in names]
            each.append(Row(condition, (Cell(estimator), *(_cell(value, 0) for value in right))))
    return [
        Table("Mean over the sequences", ("condition", *COLUMNS), tuple(means), words=False),
        Table("Right matches, %", ("condition", "estimator", *names), tuple(each), words=False),
    ]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _cell(value: float | None, digits: int) -> Cell:
    return Cell("-" if value is None else f"{value:.{digits}f}")


def chosen_sequences(arguments: argparse.Namespace) -> dict[str, Description]:
    """The descriptions of the robots and objects that are asked for. Raises InputError where one is missing."""
    found = {name: robot_description(name, arguments.assets) for name in _names(arguments.robots)}
    if arguments.objects is not None:
        own = dict(own_descriptions(arguments.objects))
        wanted = _names(arguments.only) or list(own)
        if missing := set(wanted) - set(own):
            raise InputError(f"--only: found {', '.join(sorted(missing))}, expected names of {arguments.objects}")
        found |= {name: own[name] for name in wanted}
    if not found:
        raise InputError("no sequences: give --robots A,B or --objects FOLDER")
    return found


def chosen_conditions(words: str) -> list[Condition]:
    """The conditions whose names begin with any of the given words; all for none. Raises InputError for no match."""
    chosen = [c for c in CONDITIONS if not words or any(c.name.startswith(word) for word in _names(words))]
    if not chosen:
        raise InputError(f"--conditions {words!r}: expected beginnings of {', '.join(c.name for c in CONDITIONS)}")
    return chosen


def _names(words: str) -> list[str]:
    return [word for word in words.split(",") if word]


def main(words: list[str] | None = None) -> int:
    """Measure. The exit code is 0, or 2 where there is nothing to measure."""
    arguments = _parser().parse_args(words)
    try:
        conditions, estimators = chosen_conditions(arguments.conditions), _names(arguments.estimators)
        functions = {name: resolve("flow.estimator", name, ESTIMATORS) for name in estimators}
        measured = []
        for name, description in chosen_sequences(arguments).items():
            for condition in conditions:
                of = build(description, condition, arguments.pairs, arguments.points, arguments.seed)
                for estimator, function in functions.items():
                    config = FlowConfig(estimator=estimator)
                    measured.append(measure(name, function, config, arguments.seed, condition, of))
                    print(measured[-1], flush=True)
    except (InputError, ValidationError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    record = Record(
        date=datetime.now(UTC),
        commit=commit(),
        command=" ".join(["benchmarks/correspondences.py", *(sys.argv[1:] if words is None else words)]),
        machine=machine(),
        packages=package_versions(),
        measured=tuple(measured),
    )
    text = "\n".join(map(to_markdown, tables(measured, [c.name for c in conditions], estimators)))
    computer = record.machine
    text += f"\n`{record.command}`, commit {record.commit or '-'}, {computer.processor}, {computer.cores} cores.\n"
    stem = arguments.results / f"correspondences-{record.date:%Y-%m-%d-%H%M}"
    arguments.results.mkdir(parents=True, exist_ok=True)
    stem.with_suffix(".json").write_text(record.model_dump_json(indent=1) + "\n")
    stem.with_suffix(".md").write_text(text)
    print(f"{text}\nwritten: {stem}.json, {stem}.md")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", default="", metavar="A,B", help="robots of RoboArt")
    parser.add_argument("--assets", type=Path, help="a folder of robot descriptions, NAME/NAME.urdf")
    parser.add_argument("--objects", type=Path, help="a folder of other descriptions, NAME/NAME.urdf")
    parser.add_argument("--only", default="", metavar="A,B", help="only these objects; default: all of the folder")
    parser.add_argument("--estimators", default="geometric,hybrid", metavar="A,B")
    parser.add_argument("--conditions", default="", metavar="A,B", help="beginnings of their names; default: all")
    parser.add_argument("--pairs", type=int, default=3, help="frame pairs in each condition")
    parser.add_argument("--points", type=int, default=4096, help="points per frame")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--results", type=Path, default=FOLDER / "results", help="where the record is kept")
    return parser


if __name__ == "__main__":
    sys.exit(main())
