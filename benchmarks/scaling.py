"""Time and memory against points, frames and parts: `python benchmarks/scaling.py --workdir DIR [--assets DIR]`.

Fits RoboArt sequences of growing size, each in a run of its own with one worker, and prints wall time, the time in
stages, peak memory of the greatest stage and ARI. The table goes to benchmarks/results/scaling-DATE.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from run import BenchmarkSet, keep, run

from pipeline.results.report_tables import Cell, Row, Table
from schemas.errors import InputError

POINTS, FRAMES = (4096, 16384, 65536, 250_000), (10, 30, 100)
PARTS = ("ur5", "a1", "jvrc", "icub")  # 7, 13, 21 and 26 true parts
COLUMNS = (
    "points",
    "frames",
    "parts",
    "wall s",
    "stages s",
    "flow s",
    "relaxed_fit s",
    "final_fit s",
    "peak MiB",
    "ARI",
)


def main(words: list[str] | None = None) -> int:
    """Run the ladder. The exit code is that of the worst run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workdir", type=Path, required=True, help="where artifacts go: a fresh folder")
    parser.add_argument("--assets", type=Path, help="a folder of robot descriptions, NAME/NAME.urdf")
    parser.add_argument("--sequence", default="a1", help="the robot whose points and frames grow")
    parser.add_argument("--points", type=int, nargs="*", default=POINTS, help="a frame, where 10 frames are fitted")
    parser.add_argument("--frames", type=int, nargs="*", default=FRAMES, help="where they have 4,096 points")
    parser.add_argument("--robots", nargs="*", default=PARTS, help="of ever more parts, 10 frames of 4,096 points")
    arguments = parser.parse_args(words)
    ladder = [(arguments.sequence, points, 10) for points in arguments.points]
    ladder += [(arguments.sequence, 4096, frames) for frames in arguments.frames]
    ladder += [(name, 4096, 10) for name in arguments.robots]
    ladder = list(dict.fromkeys(ladder))
    rows, worst = [], 0
    for name, points, frames in ladder:
        try:
            row, code = step(name, points, frames, arguments.workdir, arguments.assets)
        except InputError as error:  # what was measured before is kept
            print(f"error: {error}", file=sys.stderr)
            row, code = [str(points), str(frames), "failed"], 1
        rows.append(Row(name, tuple(map(Cell, row + ["-"] * (len(COLUMNS) - len(row))))))
        print(name, *row, flush=True)
        worst = max(worst, code)
    table = Table("Scaling", ("sequence", *COLUMNS), tuple(rows), words=False)
    keep("scaling", table, "One worker, seed 0.")
    return worst


def step(name: str, points: int, frames: int, workdir: Path, assets: Path | None) -> tuple[list[str], int]:
    """A sequence fitted: its row, and the exit code. Raises InputError where there is nothing to measure."""
    chosen = BenchmarkSet(
        description="one step of the ladder",
        dataset="roboart",
        sequences=(name,),
        settings=(f"ingest.roboart.points={points}", f"ingest.roboart.frames={frames}"),
    )
    record = run("scaling", chosen, workdir / f"{name}-{points}-{frames}", 1, assets)
    sequence = record.evaluation.sequences[0]
    seconds = [record.wall_seconds, record.stage_seconds]
    seconds += [sequence.costs[stage].seconds for stage in ("flow", "relaxed_fit", "final_fit")]
    row = [str(points), str(frames), str(sequence.metrics.parts_true), *(f"{value:.1f}" for value in seconds)]
    return [*row, f"{sequence.figures.peak_memory_mib:.0f}", f"{sequence.figures.ari:.3f}"], record.exit_code


if __name__ == "__main__":
    sys.exit(main())
