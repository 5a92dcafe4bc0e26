"""What each ingredient brings: `python benchmarks/variants.py SET --workdir DIR [--assets DIR] [--only NAME ...]`.

Runs a set of benchmarks/sets as it is and with one thing changed at a time, in one working directory, so that only what
a change touches is computed again. Meshes are hulls, which are fast and of which no measure depends. The table of means
goes to benchmarks/results/variants-SET-DATE.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from run import Record, keep, read_set, run

from pipeline.cli.options import cores
from pipeline.results.report_tables import Cell, Row, Table
from schemas.errors import InputError

VARIANTS: dict[str, tuple[str, ...]] = {
    "as it is": (),
    "solver gumbel, merging by E_merge": ("relaxed_fit.solver=gumbel", "merging.threshold=0.8"),
    "no flow: the fit starts from still parts": ("flow.estimator=none",),
    "flow by geometric": ("flow.estimator=geometric",),
    "flow by hybrid": ("flow.estimator=hybrid",),
    "flow by network": ("flow.estimator=network",),
    "flow by fpfh": ("flow.estimator=fpfh",),
    "no splitting": ("relaxed_fit.alternating.closing_rounds=5",),
    "no hidden links": ("final_fit.hidden_links=false",),
    "no kinematic relabelling": ("final_fit.relabel=false",),
    "no pruning": ("final_fit.part_price=0",),
    "labels of one frame only": ("final_fit.fused_frames=1",),
    "canonical frame: the middle one": ("canonical_frame.candidates=1",),
    "canonical frame: two, a relaxed fit each": ("canonical_frame.fits=2",),
    "canonical frame: any of four": ("canonical_frame.candidates=4",),
}
FAST_EXPORT = ("export.surface=hull",)
MEASURES = (
    "ari",
    "tree_edit_distance",
    "recon_percent",
    "epe_percent",
    "reanimation_percent",
    "axis_angle_deg",
    "seconds",
)


def main(words: list[str] | None = None) -> int:
    """Run the variants. The exit code is 1 where one of the runs failed, 2 where there is nothing to run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", help="the name of a set, a file in benchmarks/sets")
    parser.add_argument("--workdir", type=Path, required=True, help="where artifacts go")
    parser.add_argument("--assets", type=Path, help="a folder of robot descriptions, NAME/NAME.urdf")
    parser.add_argument("--sequences", metavar="A,B", help="only these of the set")
    parser.add_argument("--workers", type=int, default=cores(), help="stages computed at a time; default: the cores")
    parser.add_argument("--only", nargs="+", choices=tuple(VARIANTS), metavar="NAME", help="these variants only")
    arguments = parser.parse_args(words)
    records: dict[str, Record] = {}
    try:
        chosen = read_set(arguments.set, arguments.sequences)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    worst = 0
    for name in arguments.only or VARIANTS:
        changed = chosen.model_copy(update={"settings": chosen.settings + FAST_EXPORT + VARIANTS[name]})
        try:
            records[name] = run(arguments.set, changed, arguments.workdir, arguments.workers, arguments.assets)
        except InputError as error:  # what was measured before is kept
            print(f"error: {name}: {error}", file=sys.stderr)
            worst = 1
    if not records:
        return 2
    keep(f"variants-{arguments.set}", table(records), f"Set `{arguments.set}`.")
    return max(worst, *(record.exit_code for record in records.values()))


def table(records: dict[str, Record]) -> Table:
    """Means over all sequences, a row for each variant."""
    rows = []
    for name, record in records.items():
        means = next(group.figures for group in record.evaluation.groups if group.level == "all")
        cells = [Cell("-" if (value := getattr(means, measure)) is None else f"{value:.3f}") for measure in MEASURES]
        rows.append(Row(name, tuple(cells)))
    return Table("Variants", ("variant", *MEASURES), tuple(rows), words=False)


if __name__ == "__main__":
    sys.exit(main())
