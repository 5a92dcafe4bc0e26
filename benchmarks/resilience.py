"""Whether anything breaks: `python benchmarks/resilience.py [flips|kills|hostile ...] [--seed 0] [--only NAME ...]`.

It makes two boxes with a hinge (6 frames of 400 points), fits them with the small settings of attacks/tiny.toml, and
then damages, kills and misleads what is there. It needs no data and writes into a temporary folder.

- flips: single bytes flipped (and some files cut or removed) in the artifacts and the delivered folder of a fit; each
  must be found by what reads it, or make no difference. A few go through `reart status --check`, `inspect`, `evaluate`
  and `run`.
- kills: SIGKILL at random moments of a fit, while it delivers too, to all its processes or one; the same command must
  then succeed, with the same model, with everything complete kept and nothing left over.
- hostile: the inputs of attacks/lists, by the real command line, under limits of time and memory; each must be refused
  in one line with exit code 2, be accepted without harm, or, where its case says so, fail with exit code 1 and a cause.

As root it also tries full disks and files of others. The record goes to results/resilience-DATE.json and .md; the exit
code is 0 only where all is well.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from attacks import flips, hostile, kills
from attacks.case import Judged
from attacks.hinge import Prepared, prepare
from pydantic import Field
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from run import FOLDER, Machine, commit, facts, machine

from pipeline.results.report_tables import Cell, Row, Table, to_markdown
from pipeline.run.task import package_versions
from schemas.artifact import Schema

ATTACKS = ("flips", "kills", "hostile")


class Tally(Schema):
    """How many times something was tried, and how often it held."""

    what: str
    tried: int
    held: int
    outcomes: dict[str, int]

    @property
    def well(self) -> bool:
        return self.tried == self.held


class Finding(Schema):
    """Something that did not hold."""

    what: str
    reasons: tuple[str, ...]
    similar: bool = Field(default=False, description="thought out here, alike to what was reported")
    code: int | None = None
    said: str = ""


class Record(Schema):
    """benchmarks/results/resilience-DATE.json."""

    date: datetime
    commit: str
    machine: Machine
    packages: dict[str, str]
    seed: int
    root: bool
    tallies: tuple[Tally, ...]
    findings: tuple[Finding, ...]
    verdicts: dict[str, str] = Field(default={}, description="of each hostile input")


def main(words: list[str] | None = None) -> int:
    """Attack. The exit code is 1 where something did not hold, 2 where nothing was tried."""
    arguments = _parser().parse_args(words)
    cases = hostile.choose(arguments.only) if "hostile" in arguments.attacks else {}
    if arguments.only and not cases:
        print(f"error: --only {' '.join(arguments.only)}: found no such input; --list names them", file=sys.stderr)
        return 2
    if arguments.list:
        print("\n".join(cases))
        return 0
    console = Console()
    with tempfile.TemporaryDirectory() as scratch, bars(console) as progress:
        folder = Path(scratch)
        folder.chmod(0o755)  # for commands that are given as another user
        prepared = prepare(folder / "prepared")
        rng = np.random.default_rng(arguments.seed)
        tallies: list[Tally] = []
        findings: list[Finding] = []
        judged: dict[str, Judged] = {}
        if "flips" in arguments.attacks:
            attack_bytes(prepared, folder / "flips", arguments, rng, progress, tallies, findings)
        if "kills" in arguments.attacks:
            tick = step(progress, "kills", arguments.kills)
            found = kills.attack(prepared, folder / "kills", arguments.kills, rng, tick)
            tallies.append(
                tally("kills", ["survived" if not kill.faults else "broken" for kill in found], ("survived",))
            )
            findings += [Finding(what=f"kill: {kill.plan}", reasons=kill.faults) for kill in found if kill.faults]
        if cases:
            tick = step(progress, "hostile", len(cases))
            judged = hostile.attack(cases, prepared, folder / "hostile", lambda name, entry: tick(entry))
            tallies += hostile_tallies(judged)
            findings += hostile_findings(judged)
    record = Record(
        date=datetime.now(UTC),
        commit=commit(),
        machine=machine(),
        packages=package_versions(),
        seed=arguments.seed,
        root=os.geteuid() == 0,
        tallies=tuple(tallies),
        findings=tuple(findings),
        verdicts={name: entry.verdict for name, entry in judged.items()},
    )
    text = document(record)
    print(text)
    print(f"written: {', '.join(map(str, write(record, text, arguments.results)))}")
    return 0 if tallies and all(entry.well for entry in tallies) else 1


def attack_bytes(
    prepared: Prepared,
    folder: Path,
    arguments: argparse.Namespace,
    rng: np.random.Generator,
    progress: Progress,
    tallies: list[Tally],
    findings: list[Finding],
) -> None:
    """Flips in artifacts, in the delivered folder, and by commands."""
    prepared.give(folder, "model")
    delivered = len(flips.delivered_files(folder / "model"))
    each = max(1, arguments.flips // 5)
    artifacts = folder / "model" / "workdir"
    groups = {
        "flips in artifacts": lambda tick: flips.flip_artifacts(artifacts, arguments.flips, rng, tick),
        "flips in delivered files": lambda tick: flips.flip_delivered(folder / "model", each, rng, tick),
        "flips, by commands": lambda tick: flips.flip_commands(prepared, folder, arguments.commands, rng, tick),
    }
    totals = (arguments.flips, each * delivered, arguments.commands)
    for (what, attack), total in zip(groups.items(), totals, strict=True):
        found = attack(step(progress, what, total))
        tallies.append(tally(what, [flip.found for flip in found], ("found", "same")))
        findings += flip_findings(what, found)


def flip_findings(what: str, found: Sequence[flips.Flip]) -> list[Finding]:
    """A line a file that was damaged without a word, with where that was."""
    by_file: dict[tuple[str, str], list[flips.Flip]] = {}
    for flip in found:
        if flip.found in ("missed", "escaped"):
            by_file.setdefault((flip.file, flip.found), []).append(flip)
    return [
        Finding(
            what=f"{what}: {file}",
            reasons=(
                f"{verdict}: {', '.join(f'{flip.how} at {flip.offset}' for flip in group[:5])}, {len(group)} in all",
            ),
            said=group[0].said,
        )
        for (file, verdict), group in by_file.items()
    ]


def tally(what: str, outcomes: Sequence[str], right: Sequence[str]) -> Tally:
    counts = Counter(outcomes)
    return Tally(what=what, tried=len(outcomes), held=sum(counts[name] for name in right), outcomes=dict(counts))


def hostile_tallies(judged: dict[str, Judged]) -> list[Tally]:
    """By subject; what could not be tried here is not counted as tried."""
    by_subject: dict[str, list[str]] = {}
    for name, entry in judged.items():
        by_subject.setdefault(name.partition("/")[0], []).append(entry.verdict)
    tallies = []
    for subject, verdicts in by_subject.items():
        tried = [verdict for verdict in verdicts if verdict != "skipped"]
        found = tally(f"hostile: {subject}", tried, ("refused", "accepted", "failed", "ended"))
        skipped = {"skipped": len(verdicts) - len(tried)} if len(verdicts) > len(tried) else {}
        tallies.append(found.model_copy(update={"outcomes": found.outcomes | skipped}))
    return tallies


def hostile_findings(judged: dict[str, Judged]) -> list[Finding]:
    return [
        Finding(
            what=name,
            reasons=entry.reasons,
            similar=entry.case.similar,
            code=entry.ran.code if entry.ran else None,
            said=" ".join(entry.ran.words.split())[-500:] if entry.ran else "",
        )
        for name, entry in judged.items()
        if entry.verdict in ("broken", "skipped")
    ]


def document(record: Record) -> str:
    """The tables in Markdown."""
    rows = [
        Row(
            entry.what,
            (
                Cell(f"{entry.held} of {entry.tried}"),
                Cell(", ".join(f"{name} {count}" for name, count in sorted(entry.outcomes.items()))),
            ),
        )
        for entry in record.tallies
    ]
    broken = [
        Row(f"{entry.what}{' *' if entry.similar else ''}", (Cell("; ".join(entry.reasons)), Cell(entry.said[:200])))
        for entry in record.findings
    ]
    parts = [to_markdown(Table("Resilience", ("what", "held", "outcomes"), tuple(rows), words=True))]
    if broken:
        parts.append(to_markdown(Table("What did not hold", ("what", "why", "said"), tuple(broken), words=True)))
    root = "" if record.root else " Not as root: what needs that was left out."
    return "\n".join([*parts, f"Seed {record.seed}.{root} {facts()}\n"])


def write(record: Record, text: str, folder: Path) -> tuple[Path, Path]:
    """Keep a record as JSON and Markdown."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder / f"resilience-{record.date:%Y-%m-%d-%H%M}"
    json_path, markdown_path = stem.with_suffix(".json"), stem.with_suffix(".md")
    json_path.write_text(record.model_dump_json(indent=1) + "\n")
    markdown_path.write_text(text)
    return json_path, markdown_path


def bars(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[wrong]} wrong"),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def step(progress: Progress, what: str, total: int) -> Callable[[object], None]:
    """What moves a new bar on by one, and counts what is wrong."""
    task = progress.add_task(what, total=total, wrong=0)
    wrong = 0

    def tick(entry: object) -> None:
        nonlocal wrong
        wrong += bool(getattr(entry, "faults", ())) or getattr(entry, "verdict", "") == "broken"
        wrong += getattr(entry, "found", "") in ("missed", "escaped")
        progress.update(task, advance=1, wrong=wrong)

    return tick


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("attacks", nargs="*", choices=ATTACKS, default=ATTACKS, help="which; default: all")
    parser.add_argument("--seed", type=int, default=0, help="of bytes and moments")
    parser.add_argument("--flips", type=int, default=1500, help="in artifacts; a fifth of it in each delivered file")
    parser.add_argument("--commands", type=int, default=20, help="flips that go through commands")
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--only", nargs="+", default=(), metavar="NAME", help="hostile inputs whose names begin so")
    parser.add_argument("--list", action="store_true", help="name the hostile inputs, and do nothing")
    parser.add_argument("--results", type=Path, default=FOLDER / "results", help="where the record is kept")
    return parser


if __name__ == "__main__":
    sys.exit(main())
