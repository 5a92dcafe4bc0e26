"""Plain made-up objects of two or three parts, in few and far states and at unequal densities: what is found of them.

`python benchmarks/hinges.py [--only WORD ...] [--set KEY=VALUE ...]` makes the sequences (always the same), fits each
as `reart fit` does, and prints a line for each: parts found and true, adjusted Rand index, and the confidence of each
joint's parts. The bodies are made of boxes: plates, a laptop, a door in its frame, scissors, a drawer, a chain of bars.
`--frames DIR` writes the frames instead, for `reart fit DIR/NAME --out OUT`.
"""

from __future__ import annotations

import argparse
import sys
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64
from run import facts
from sklearn.metrics import adjusted_rand_score

from pipeline.configuration.presets import load_config
from schemas.config import PipelineConfig
from schemas.kinematic import KinematicModel
from stages.canonical_frame.candidates import candidate_frames
from stages.canonical_frame.stage import compute_canonical_frame
from stages.final_fit.stage import compute_final_fit
from stages.flow.stage import compute_flow
from stages.ingest.normalise import normalise
from stages.ingest.readers import Frame
from stages.merging.stage import compute_merging
from stages.projection.stage import compute_projection
from stages.relaxed_fit.carry_over import carry_over
from stages.relaxed_fit.stage import compute_relaxed_fit

Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # its least and greatest corner
X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class Joint:
    """What moves a part against an earlier one, in the pose where all states are zero."""

    parent: int
    revolute: bool
    axis: np.ndarray
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    low: float = 0.0  # radians, or metres
    high: float = 1.0


@dataclass(frozen=True)
class Body:
    """Boxes of each part; the joint of each part but the first."""

    parts: tuple[tuple[Box, ...], ...]
    joints: tuple[Joint, ...]


@dataclass(frozen=True)
class Case:
    """A body, what its joints move by from frame to frame, and the points of each frame."""

    body: str
    step: float  # degrees; a slide goes so many eightieths of its range
    counts: tuple[int, ...]
    noise: float = 0.0  # standard deviation, in metres

    @property
    def name(self) -> str:
        counts = f"{self.counts[0]}" if len(set(self.counts)) == 1 else "-".join(map(str, self.counts))
        noise = f"-noise{1000 * self.noise:g}mm" if self.noise else ""
        return f"{self.body}-{len(self.counts)}x{self.step:g}-{counts}{noise}"


def box(x: float, y: float, z: float, dx: float, dy: float, dz: float) -> Box:
    return (x, y, z), (x + dx, y + dy, z + dz)


def hollow(x: float, y: float, z: float, dx: float, dy: float, dz: float, wall: float, top: bool) -> tuple[Box, ...]:
    """A box without its front (least x) and, unless `top`, without its upper side; its walls do not overlap."""
    inner = dy - 2 * wall
    sides = (box(x, y, z, dx, wall, dz), box(x, y + dy - wall, z, dx, wall, dz))
    floor = (box(x, y + wall, z, dx, inner, wall),)
    back = (box(x + dx - wall, y + wall, z + wall, wall, inner, dz - wall - wall * top),)
    return sides + floor + back + ((box(x, y + wall, z + dz - wall, dx, inner, wall),) if top else ())


RIGHT = np.pi / 2
BODIES: dict[str, Body] = {
    "plates": Body(
        ((box(0, 0, -0.01, 0.5, 0.4, 0.01),), (box(0, 0, 0, 0.5, 0.4, 0.01),)), (Joint(0, True, -Y, low=0.4, high=2.9),)
    ),
    "boxes": Body(
        ((box(-0.3, 0, -0.1, 0.3, 0.2, 0.1),), (box(0, 0, -0.1, 0.25, 0.2, 0.1),)),
        (Joint(0, True, -Y, low=0.1, high=2.8),),
    ),
    "laptop": Body(
        ((box(0, 0, -0.02, 0.25, 0.36, 0.02),), (box(0, 0, 0.002, 0.25, 0.36, 0.008),)),
        (Joint(0, True, -Y, (0, 0, 0), 0.4, 2.4),),
    ),
    "door": Body(
        (
            (
                box(-0.1, -0.05, 0, 0.1, 0.1, 2.1),
                box(0.92, -0.05, 0, 0.1, 0.1, 2.1),
                box(0, -0.05, 2.0, 0.92, 0.1, 0.1),
            ),
            (box(0.01, 0.01, 0.02, 0.9, 0.04, 1.97),),
        ),
        (Joint(0, True, Z, (0.01, 0.05, 0), 0.2, 2.2),),
    ),
    "scissors": Body(
        ((box(-0.2, -0.02, -0.01, 0.4, 0.04, 0.01),), (box(-0.25, -0.015, 0.001, 0.4, 0.03, 0.01),)),
        (Joint(0, True, Z, (0, 0, 0), 0.4, 2.6),),
    ),
    "drawer": Body(
        (
            hollow(0, 0, 0, 0.5, 0.4, 0.3, 0.015, True),
            (
                box(-0.02, 0.02, 0.02, 0.02, 0.36, 0.26),
                *hollow(0, 0.03, 0.03, 0.44, 0.34, 0.18, 0.01, False),
            ),
        ),
        (Joint(0, False, -X, low=0.0, high=0.4),),
    ),
    "slider": Body(
        ((box(0, 0, 0, 0.6, 0.1, 0.04),), (box(0.02, -0.01, 0.042, 0.12, 0.12, 0.08),)),
        (Joint(0, False, X, low=0.0, high=0.42),),
    ),
    "chain": Body(
        (
            (box(-0.15, -0.1, 0, 0.3, 0.2, 0.05),),
            (box(-0.02, -0.02, 0.05, 0.04, 0.04, 0.35),),
            (box(-0.015, -0.015, 0.4, 0.03, 0.03, 0.3),),
        ),
        (Joint(0, True, Y, (0, 0, 0.05), -0.9, 0.9), Joint(1, True, Y, (0, 0, 0.4), -1.6, 1.6)),
    ),
    "flaps": Body(
        (
            (box(-0.2, 0, -0.2, 0.4, 0.3, 0.2),),
            (box(-0.2, 0, 0.002, 0.195, 0.3, 0.008),),
            (box(0.005, 0, 0.002, 0.195, 0.3, 0.008),),
        ),
        (Joint(0, True, Y, (-0.2, 0, 0), -2.4, -0.2), Joint(0, True, -Y, (0.2, 0, 0), -2.4, -0.2)),
    ),
    "cabinet": Body(
        (
            hollow(0, 0, 0, 0.4, 0.5, 0.6, 0.02, True),
            (box(-0.02, 0.0, 0.25, 0.018, 0.5, 0.35),),
            (
                box(-0.02, 0.0, 0.0, 0.018, 0.5, 0.24),
                *hollow(0, 0.04, 0.03, 0.34, 0.42, 0.16, 0.01, False),
            ),
        ),
        (Joint(0, True, -Z, (-0.002, 0, 0), 0.2, 2.2), Joint(0, False, -X, low=0.02, high=0.3)),
    ),
}


def states(body: Body, step: float, frames: int, rng: np.random.Generator) -> Float64[np.ndarray, "joints frames"]:
    """To and fro within each joint's range, from a place of its own."""
    rows = []
    for joint in body.joints:
        span = joint.high - joint.low
        stride = min(np.radians(step) if joint.revolute else step / 80 * span, span)
        way = rng.uniform(0, max(span - stride * (frames - 1), 0)) + stride * np.arange(frames)
        rows.append(joint.low + span - np.abs(way % (2 * span) - span))
    return np.array(rows)


def turned(axis: np.ndarray, angle: float) -> Float64[np.ndarray, "3 3"]:
    K = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def motions(body: Body, at: Float64[np.ndarray, "joints"]) -> Float64[np.ndarray, "parts 4 4"]:
    Ts = [np.eye(4)]
    for joint, state in zip(body.joints, at, strict=True):
        T = np.eye(4)
        if joint.revolute:
            T[:3, :3] = turned(joint.axis, state)
            T[:3, 3] = joint.point - T[:3, :3] @ np.asarray(joint.point)
        else:
            T[:3, 3] = state * joint.axis
        Ts.append(Ts[joint.parent] @ T)
    return np.array(Ts)


def sample(
    body: Body, Ts: Float64[np.ndarray, "parts 4 4"], count: int, rng: np.random.Generator
) -> tuple[Float64[np.ndarray, "points 3"], Int64[np.ndarray, "points"]]:
    """Points of the boxes' faces by area, and the part of each."""
    low, size, owner = [], [], []
    for part, boxes in enumerate(body.parts):
        for least, greatest in boxes:
            low.append(least)
            size.append(np.subtract(greatest, least))
            owner.append(part)
    sides, corner = np.array(size), np.array(low)
    areas = sides[:, [1, 0, 0]] * sides[:, [2, 2, 1]]  # of the faces across x, y and z
    chosen = rng.choice(6 * len(sides), size=count, p=np.repeat(areas, 2, axis=1).ravel() / (2 * areas.sum()))
    which, face = np.divmod(chosen, 6)
    unit = rng.uniform(size=(count, 3))
    unit[np.arange(count), face // 2] = face % 2
    p, labels = corner[which] + unit * sides[which], np.array(owner)[which]
    T = Ts[labels]
    return np.einsum("nij,nj->ni", T[:, :3, :3], p) + T[:, :3, 3], labels


def make(case: Case) -> tuple[list[Float64[np.ndarray, "points 3"]], list[Int64[np.ndarray, "points"]]]:
    """Frames and true labels of a case, which depend on nothing but its name."""
    rng, body = np.random.default_rng(zlib.crc32(case.name.encode())), BODIES[case.body]
    at = states(body, case.step, len(case.counts), rng)
    drawn = [sample(body, motions(body, at[:, t]), count, rng) for t, count in enumerate(case.counts)]
    return [p + rng.normal(scale=case.noise, size=p.shape) for p, _ in drawn], [labels for _, labels in drawn]


def few_states() -> list[Case]:
    """Two to ten frames of like densities."""
    settings = [(2, 60, 800), (2, 30, 2000), (3, 45, 800), (3, 20, 500), (5, 30, 5000), (10, 20, 1000)]
    return [Case(body, step, (count,) * frames) for body in BODIES for frames, step, count in settings]


def unequal_densities() -> list[Case]:
    """Frames of which one is far denser than another."""
    settings = [
        (30, (800, 200_000, 100)),
        (45, (5000, 500)),
        (20, (300, 20_000, 300, 3000)),
        (25, (2000, 2000, 150, 2000, 2000)),
    ]
    return [Case(body, step, counts) for body in BODIES for step, counts in settings]


def noisy() -> list[Case]:
    return [Case(body, 40, (1500,) * 3, 0.002) for body in BODIES]


def fit(frames: Sequence[Float64[np.ndarray, "points 3"]], config: PipelineConfig) -> KinematicModel:
    """The chosen candidate's final model, by the stages that `reart fit` runs."""
    named = [Frame(f"frame {t}", p) for t, p in enumerate(frames)]
    sequence = normalise(named, config.ingest, "metre")
    rng = np.random.default_rng(config.seed)
    flow = compute_flow(sequence, config.flow, rng)
    candidates = candidate_frames(sequence.point_counts.tolist(), config.canonical_frame)
    first = compute_relaxed_fit(sequence, flow, candidates[0], config.relaxed_fit, rng)
    models = []
    for rank, frame in enumerate(candidates):
        relaxed = first if rank == 0 else carry_over(first, sequence, frame)
        linked = compute_merging(
            compute_projection(relaxed, sequence, config.projection), sequence, config.merging, config.projection
        )
        models.append(compute_final_fit(linked, sequence, flow, config.final_fit, rng))
    return compute_canonical_frame(models, sequence, config.canonical_frame.by, config.final_fit).model


@dataclass(frozen=True)
class Outcome:
    """What was found of one case."""

    case: Case
    parts: int
    ari: float
    types_right: bool  # where the number of parts is right: as many hinges as there are
    part_confidence: tuple[float, ...]  # of each joint
    seconds: float

    @property
    def true_parts(self) -> int:
        return len(BODIES[self.case.body].parts)

    def line(self) -> str:
        sure = " ".join(f"{value:.2f}" for value in self.part_confidence)
        found = f"{self.parts} of {self.true_parts} parts{'' if self.parts == self.true_parts else ' WRONG'}"
        types = "" if self.types_right else "  types wrong"
        return f"{self.case.name:40s} {found:20s} ARI {self.ari:.3f}  part {sure}{types}  {self.seconds:.0f} s"


def measure(
    case: Case, model: KinematicModel, labels: Sequence[Int64[np.ndarray, "points"]], seconds: float
) -> Outcome:
    true = sorted("revolute" if joint.revolute else "prismatic" for joint in BODIES[case.body].joints)
    confidence = model.confidence if model.confidence is not None else np.zeros((0, 3))
    return Outcome(
        case=case,
        parts=model.part_count,
        ari=float(adjusted_rand_score(labels[model.canonical_frame], model.labels)),
        types_right=sorted(map(str, model.joint_types)) == true or model.part_count != len(true) + 1,
        part_confidence=tuple(confidence[:, 0].tolist()),
        seconds=seconds,
    )


def summary(name: str, outcomes: Sequence[Outcome]) -> str:
    right = sum(outcome.parts == outcome.true_parts for outcome in outcomes)
    many = sum(outcome.parts > outcome.true_parts for outcome in outcomes)
    ari = np.mean([outcome.ari for outcome in outcomes])
    types = sum(outcome.types_right for outcome in outcomes)
    return (
        f"{name:20s} {len(outcomes):3d} cases: parts right {right}, too many {many}, too few "
        f"{len(outcomes) - right - many}; ARI {ari:.3f}; types right {types}"
    )


SETS: dict[str, Callable[[], list[Case]]] = {
    "few states": few_states,
    "unequal densities": unequal_densities,
    "noise of 2 mm": noisy,
}


def main(words: list[str] | None = None) -> int:
    """Make, fit and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", metavar="WORD", default=[""], help="cases whose name holds one of these")
    parser.add_argument("--set", dest="settings", nargs="+", metavar="KEY=VALUE", default=[], help="as in reart fit")
    parser.add_argument("--frames", type=Path, metavar="DIR", help="write the cases' frames there, and fit nothing")
    arguments = parser.parse_args(words)
    config = load_config(["scans"], arguments.settings)
    everything: list[Outcome] = []
    for name, cases in SETS.items():
        outcomes = []
        for case in cases():
            if not any(word in case.name for word in arguments.only):
                continue
            frames, labels = make(case)
            if arguments.frames:
                arguments.frames.mkdir(parents=True, exist_ok=True)
                for t, p in enumerate(frames):
                    (arguments.frames / case.name).mkdir(exist_ok=True)
                    np.save(arguments.frames / case.name / f"{t:02d}.npy", p)
                continue
            clock = time.perf_counter()
            model = fit(frames, config)
            outcomes.append(measure(case, model, labels, time.perf_counter() - clock))
            print(outcomes[-1].line(), flush=True)
        if outcomes:
            print(summary(name, outcomes), flush=True)
        everything += outcomes
    if everything:
        print(summary("all", everything))
        print(f"{facts()} Seed {config.seed}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
