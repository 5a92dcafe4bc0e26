"""Time and memory against points, frames and parts: `python benchmarks/scaling.py --workdir DIR [--assets DIR]`.

Fits RoboArt sequences of growing size, each in a run of its own with one worker, and prints wall time, the time in
stages, peak memory of the greatest stage and ARI. The table goes to benchmarks/results/scaling-DATE.md.
"""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path

from run import FOLDER, BenchmarkSet, commit, machine, run

from pipeline.report_tables import Cell, Row, Table, to_markdown
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
    """Run the ladder. The exit code is that of the worst run, or 2 where there is nothing to run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workdir", type=Path, required=True, help="where artifacts go: a fresh folder")
    parser.add_argument("--assets", type=Path, help="a folder of robot descriptions, NAME/NAME.urdf")
    parser.add_argument("--sequence", default="a1", help="the robot whose points and frames grow")
    arguments = parser.parse_args(words)
    ladder = [(arguments.sequence, points, 10) for points in POINTS]
    ladder += [(arguments.sequence, 4096, frames) for frames in FRAMES[1:]]
    ladder += [(name, 4096, 10) for name in PARTS if name != arguments.sequence]
    rows, worst = [], 0
    try:
        for name, points, frames in ladder:
            record = run(
                "scaling",
                BenchmarkSet(
                    description="one step of the ladder",
                    dataset="roboart",
                    sequences=(name,),
                    settings=(f"ingest.roboart.points={points}", f"ingest.roboart.frames={frames}"),
                ),
                arguments.workdir / f"{name}-{points}-{frames}",
                1,
                arguments.assets,
            )
            sequence = record.evaluation.sequences[0]
            figures = sequence.figures
            cells = [points, frames, sequence.metrics.parts_true, record.wall_seconds, record.stage_seconds]
            cells += [sequence.costs[stage].seconds for stage in ("flow", "relaxed_fit", "final_fit")]
            texts = [f"{cell:.1f}" if isinstance(cell, float) else str(cell) for cell in cells]
            texts += [f"{figures.peak_memory_mib:.0f}", f"{figures.ari:.3f}"]
            rows.append(Row(name, tuple(map(Cell, texts))))
            print(name, *texts, flush=True)
            worst = max(worst, record.exit_code)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    computer = machine()
    text = to_markdown(Table("Scaling", ("sequence", *COLUMNS), tuple(rows), words=False))
    text += f"\nCommit {commit() or '-'}, {computer.processor}, {computer.cores} cores, one worker.\n"
    path = FOLDER / "results" / f"scaling-{datetime.now(UTC):%Y-%m-%d-%H%M}.md"
    path.write_text(text)
    print(f"{text}\nwritten: {path}")
    return worst


if __name__ == "__main__":
    sys.exit(main())
