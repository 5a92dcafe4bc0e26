"""Quality and speed on a named set of sequences: `python benchmarks/run.py SET --workdir DIR [--data DIR]`.

A set is benchmarks/sets/SET.toml. Its sequences go through `reart run`; the evaluation is printed and kept, with the
date, commit, machine, package versions, wall time and the orchestration's overhead, in benchmarks/results/SET-DATE.json
and .md. What is complete in the working directory is not computed again, so times tell something only in a fresh one.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import time
import tomllib
from datetime import UTC, datetime
from pathlib import Path

from pydantic import Field, ValidationError

from pipeline.cli.options import cores
from pipeline.results.comparison import compare
from pipeline.results.evaluation_files import document
from pipeline.results.report_tables import Cell, Row, Table, comparison_tables, to_markdown
from pipeline.results.scores import read_scores
from pipeline.run.task import package_versions
from pipeline.store import artifacts
from schemas.artifact import Schema
from schemas.errors import InputError
from schemas.scores import Comparison, Scores

FOLDER = Path(__file__).parent


class BenchmarkSet(Schema):
    """benchmarks/sets/NAME.toml: which sequences, with which settings."""

    description: str
    dataset: str
    sequences: tuple[str, ...] | None = Field(default=None, description="only these; all where it is absent")
    preset: str | None = None
    settings: tuple[str, ...] = Field(default=(), description="as --set takes them")
    seed: int = 0
    assets: bool = Field(default=False, description="it needs robot descriptions that no package ships: --assets")


class Machine(Schema):
    """What the times depend on."""

    processor: str
    cores: int = Field(description="that this process may use")
    memory_gib: float
    system: str


class Record(Schema):
    """benchmarks/results/NAME-DATE.json: one run of a set."""

    name: str
    set: BenchmarkSet
    date: datetime
    commit: str = Field(description="with `+changes` where the tree held changes that were not committed")
    machine: Machine
    packages: dict[str, str]
    workers: int
    exit_code: int
    wall_seconds: float
    stage_seconds: float = Field(description="reading and computing in the stages that this run computed, added up")
    evaluation: Scores

    @property
    def overhead(self) -> float | None:
        """The share of the workers' time that went into no stage: orchestration, storing, start and end, and waiting.

        A worker waits where fewer tasks than workers are left. With one worker there is no such time.
        """
        spent = self.workers * self.wall_seconds
        return (spent - self.stage_seconds) / spent if self.stage_seconds else None


def main(words: list[str] | None = None) -> int:
    """Run a set. The exit code is that of `reart run`, or 2 where there is nothing to run."""
    arguments = _parser().parse_args(words)
    try:
        earlier = None if arguments.against is None else read_record(arguments.against)
        chosen = read_set(arguments.set, arguments.sequences)
        if arguments.seed is not None:
            chosen = chosen.model_copy(update={"seed": arguments.seed})
        record = run(arguments.set, chosen, arguments.workdir, arguments.workers, arguments.data)
        comparison = None
        if earlier is not None:
            comparison = compare(earlier.evaluation, record.evaluation, arguments.against.name)
        written = write(record, comparison, arguments.results)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(to_markdown(run_table(record)))
    for table in comparison_tables(comparison) if comparison else ():
        print(to_markdown(table))
    print(f"written: {', '.join(map(str, written))}")
    return record.exit_code


def read_set(name: str, sequences: str | None = None) -> BenchmarkSet:
    """A named set, or those of its sequences that are named, as in "a1,ur5".

    Raises InputError for an unknown set, or one that says what a set cannot.
    """
    path = FOLDER / "sets" / f"{name}.toml"
    if not path.is_file():
        known = ", ".join(sorted(path.stem for path in path.parent.glob("*.toml")))
        raise InputError(f"set {name!r}: not found, expected one of {known}; or write {path}")
    try:
        chosen = BenchmarkSet.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, ValidationError) as error:
        raise InputError(f"{path}: not a set ({' '.join(str(error).split())}); correct the file") from error
    return chosen if sequences is None else chosen.model_copy(update={"sequences": tuple(sequences.split(","))})


def command(chosen: BenchmarkSet, workdir: Path, workers: int, data: Path | None) -> list[str]:
    """The words of `reart run` for a set."""
    words = ["run", "--dataset", chosen.dataset, "--workdir", str(workdir), "--workers", str(workers)]
    words += ["--seed", str(chosen.seed)]
    if data is not None:
        words += ["--data", str(data)]
    if chosen.sequences is not None:
        words += ["--sequences", ",".join(chosen.sequences)]
    if chosen.preset is not None:
        words += ["--preset", chosen.preset]
    return words + [word for setting in chosen.settings for word in ("--set", setting)]


def run(name: str, chosen: BenchmarkSet, workdir: Path, workers: int, data: Path | None) -> Record:
    """Run a set through `reart run`. Raises InputError where that evaluates nothing."""
    if chosen.assets and data is None and (chosen.dataset.startswith("urdf") or not os.environ.get("REART_ASSETS")):
        raise InputError(f"set {name!r}: needs a folder of descriptions, NAME/NAME.urdf; give --assets FOLDER")
    started, clock = datetime.now(UTC), time.perf_counter()
    reart = [sys.executable, "-c", "from pipeline.cli import app; app()"]
    code = subprocess.run([*reart, *command(chosen, workdir, workers, data)]).returncode
    wall = time.perf_counter() - clock
    path = workdir / chosen.dataset / "evaluation" / "evaluation.json"
    if not path.is_file() or (evaluation := read_scores(path)).created < started:
        raise InputError(f"set {name!r}: `reart run` ended with exit code {code} and evaluated nothing; see above")
    return Record(
        name=name,
        set=chosen,
        date=started,
        commit=commit(),
        machine=machine(),
        packages=package_versions(),
        workers=workers,
        exit_code=code,
        wall_seconds=wall,
        stage_seconds=stage_seconds(workdir / chosen.dataset, started),
        evaluation=evaluation,
    )


def stage_seconds(folder: Path, since: datetime) -> float:
    """The seconds of all artifacts of a data set that were made since a moment."""
    manifests = (artifacts.read_manifest(path.parent) for path in folder.glob(f"*/*/{artifacts.MANIFEST}"))
    return sum(sum(manifest.seconds.values()) for manifest in manifests if manifest.created >= since)


def commit() -> str:
    """The commit of this tree; empty where it is none."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=FOLDER, capture_output=True, text=True)
        return done.stdout.strip() if done.returncode == 0 else ""

    name = git("rev-parse", "HEAD")
    return f"{name}+changes" if name and git("status", "--porcelain", "--untracked-files=no") else name


def machine() -> Machine:
    """This machine, as far as the system tells it."""
    processor = platform.processor() or platform.machine()
    information = Path("/proc/cpuinfo")
    if information.is_file():
        names = [
            line.partition(":")[2].strip() for line in information.read_text().splitlines() if "model name" in line
        ]
        processor = names[0] if names else processor
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return Machine(
        processor=processor, cores=cores(), memory_gib=round(memory / 2**30, 1), system=platform.platform(terse=True)
    )


def facts() -> str:
    """Of which commit and machine figures are, in a line."""
    computer = machine()
    packages = ", ".join(f"{name} {version}" for name, version in package_versions().items())
    where = f"{computer.processor}, {computer.cores} cores, {computer.memory_gib} GiB"
    return f"Commit {commit() or '-'}; {where}; {packages}."


def keep(name: str, table: Table, words: str) -> None:
    """Print a table of several runs with `words` and the facts below it, and write it to results/NAME-DATE.md."""
    text = f"{to_markdown(table)}\n{words} {facts()}\n"
    path = FOLDER / "results" / f"{name}-{datetime.now(UTC):%Y-%m-%d-%H%M}.md"
    path.write_text(text)
    print(f"{text}\nwritten: {path}")


def run_table(record: Record) -> Table:
    """What a run was, and how long it took."""
    computer = record.machine
    facts = {
        "set": f"{record.name}: {record.set.description}",
        "date": f"{record.date:%Y-%m-%d %H:%M} UTC",
        "commit": record.commit or "-",
        "machine": f"{computer.processor}, {computer.cores} cores, {computer.memory_gib} GiB, {computer.system}",
        "packages": ", ".join(f"{name} {version}" for name, version in record.packages.items()),
        "workers": str(record.workers),
        "exit code of the run": str(record.exit_code),
        "wall time": f"{record.wall_seconds:.1f} s",
        "time in stages": f"{record.stage_seconds:.1f} s",
        "overhead": "-" if record.overhead is None else f"{record.overhead:.1%}",
    }
    return Table("Run", ("what", "value"), tuple(Row(name, (Cell(fact),)) for name, fact in facts.items()), words=True)


def write(record: Record, comparison: Comparison | None, folder: Path) -> tuple[Path, Path]:
    """Keep a record as JSON and Markdown."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{record.name}-{record.date:%Y-%m-%d-%H%M}"
    json_path, markdown_path = folder / f"{stem}.json", folder / f"{stem}.md"
    json_path.write_text(record.model_dump_json(indent=1) + "\n")
    markdown_path.write_text(f"{to_markdown(run_table(record))}\n{document(record.evaluation, comparison)}")
    return json_path, markdown_path


def read_record(path: Path) -> Record:
    """A record that was written earlier. Raises InputError where the file is not one."""
    try:
        return Record.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        what = " ".join(str(error).split())
        raise InputError(f"--against {path}: not a record ({what}); give a .json of benchmarks/results") from error


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", help="the name of a set, a file in benchmarks/sets")
    parser.add_argument("--workdir", type=Path, required=True, help="where artifacts go; a fresh one for timing")
    parser.add_argument(
        "--data", "--assets", type=Path, help="the folder of sequences, or of robot descriptions, NAME/NAME.urdf"
    )
    parser.add_argument("--seed", type=int, help="instead of the set's")
    parser.add_argument("--sequences", metavar="A,B", help="only these of the set")
    parser.add_argument("--workers", type=int, default=cores(), help="stages computed at a time; default: the cores")
    parser.add_argument("--against", type=Path, help="an earlier record: show what got better or worse since")
    parser.add_argument("--results", type=Path, default=FOLDER / "results", help="where records are kept")
    return parser


if __name__ == "__main__":
    sys.exit(main())
