"""The hostile inputs, one after the other, each in a folder of its own."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from attacks.case import Case, Judged, judge
from attacks.hinge import Prepared
from attacks.lists import all_cases


def choose(only: Sequence[str]) -> dict[str, Case]:
    """The cases whose `subject/name` begins with one of these; all where there is none."""
    return {name: case for name, case in all_cases().items() if not only or name.startswith(tuple(only))}


def attack(
    cases: dict[str, Case], prepared: Prepared, folder: Path, report: Callable[[str, Judged], None]
) -> dict[str, Judged]:
    """The verdict on each case; `report` hears of each as it comes."""
    judged = {}
    for index, (name, case) in enumerate(cases.items()):
        own = folder / f"{index:04d}"
        try:
            judged[name] = judge(case, own, prepared)
        except Exception as error:  # the case's own files could not be made: that is no word on the product
            judged[name] = Judged(case, "skipped", (f"the case itself failed: {type(error).__name__}: {error}",))
        report(name, judged[name])
        remove(own)
    return judged


def remove(folder: Path) -> None:
    """A case's folder, whatever it was made to be."""
    shutil.rmtree(folder, ignore_errors=True)
    if folder.exists() and os.name == "posix":
        subprocess.run(["rm", "-rf", "--", folder], check=False)


def counts(judged: dict[str, Judged]) -> Counter[str]:
    return Counter(entry.verdict for entry in judged.values())
