"""What the clean-up takes: `python benchmarks/clean_up.py --assets DIR [--every N]`.

Every object in a folder of URDFs is scanned in three states, each in upright coordinates of its own, from six
viewpoints and with noise of 0.2 % of the diagonal. Each row adds something that is not the object, or nothing, and
cleans up. It tells the share of that which is taken, and the share of the object, over all frames. The table goes to
benchmarks/results/clean-up-DATE.md.
"""

from __future__ import annotations

import argparse
import logging
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from run import keep

from pipeline.results.report_tables import Cell, Row, Table
from schemas.config import ArtefactsConfig, CleanConfig, IngestConfig, RoboartConfig
from schemas.errors import InputError
from schemas.sequence import NO_PART
from stages.ingest.cleaning import clean
from stages.ingest.readers import Frame
from stages.ingest.sources import list_sources

SCAN = RoboartConfig(frames=3, motion="states", coordinates="upright", viewpoints=6, moving_viewpoints=True)
NOISE = 0.2  # % of the diagonal


@dataclass(frozen=True)
class Condition:
    """What is added to the scans, and what is to take it away."""

    artefacts: ArtefactsConfig
    clean: CleanConfig
    noise: float = NOISE


CONDITIONS = {
    "plane; table of 1.2 diagonals": Condition(ArtefactsConfig(table_size=1.2), CleanConfig(plane=True)),
    "plane; table of 0.8 diagonals": Condition(ArtefactsConfig(table_size=0.8), CleanConfig(plane=True)),
    "plane; table of 2 diagonals, noise 0.5 %": Condition(
        ArtefactsConfig(table_size=2.0), CleanConfig(plane=True), 0.5
    ),
    "plane; table, 2 % strays": Condition(ArtefactsConfig(table_size=1.2, outlier_share=0.02), CleanConfig(plane=True)),
    "plane; nothing": Condition(ArtefactsConfig(), CleanConfig(plane=True)),
    "outliers=2; 2 % strays": Condition(ArtefactsConfig(outlier_share=0.02), CleanConfig(outliers=2)),
    "outliers=2; nothing": Condition(ArtefactsConfig(), CleanConfig(outliers=2)),
    "specks=0.01; 2 % strays": Condition(ArtefactsConfig(outlier_share=0.02), CleanConfig(specks=0.01)),
    "specks=0.01; nothing": Condition(ArtefactsConfig(), CleanConfig(specks=0.01)),
    "all three; table, 2 % strays": Condition(
        ArtefactsConfig(table_size=1.2, outlier_share=0.02), CleanConfig(plane=True, outliers=2, specks=0.01)
    ),
}
COLUMNS = (
    "clean-up; what is there beside the object",
    "frames",
    "of that taken, %",
    "frames with less than 90 % of that taken, %",
    "of the object taken: median, %",
    "mean, %",
    "95th percentile, %",
)


def main(words: list[str] | None = None) -> int:
    """Measure. The exit code is 2 where there is nothing to measure on."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", type=Path, required=True, help="a folder of URDFs")
    parser.add_argument("--every", type=int, default=1, help="only every so many-th object")
    arguments = parser.parse_args(words)
    logging.getLogger("rearticulate").setLevel(logging.ERROR)  # that no plane is found is counted
    try:
        rows = [measured(name, condition, arguments.assets, arguments.every) for name, condition in CONDITIONS.items()]
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    words_below = __doc__.partition("\n\n")[2].rpartition(" The table")[0]
    keep("clean-up", Table("Clean-up", COLUMNS, tuple(rows), words=False), words_below)
    return 0


def measured(name: str, condition: Condition, assets: Path, every: int) -> Row:
    """One row: the clean-up of all frames of all objects."""
    scan = SCAN.model_copy(update={"artefacts": condition.artefacts, "noise_percent": condition.noise})
    config = IngestConfig(source="urdf", roboart=scan)
    taken = []
    for source in list_sources(config, assets)[::every]:
        ingested = source.load(config, np.random.default_rng(0))
        frames = [Frame(str(t), p) for t, p in enumerate(ingested.sequence.frames())]
        cleaned = clean(frames, IngestConfig(clean=condition.clean, min_points=4), np.random.default_rng(0))
        for t, kept in enumerate(cleaned.kept):
            beside = ingested.true_labels(t) == NO_PART
            taken.append([_share(~kept[beside]), _share(~kept[~beside])])
    rest, thing = 100 * np.array(taken).T
    there = rest[np.isfinite(rest)]
    figures = [f"{there.mean():.1f}", f"{100 * (there < 90).mean():.1f}"] if len(there) else ["-", "-"]
    figures += [f"{np.median(thing):.2f}", f"{thing.mean():.2f}", f"{np.quantile(thing, 0.95):.2f}"]
    return Row(name, tuple(map(Cell, [str(len(taken)), *figures])))


def _share(mask: np.ndarray) -> float:
    return float(mask.mean()) if len(mask) else np.nan


if __name__ == "__main__":
    sys.exit(main())
