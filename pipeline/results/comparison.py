"""The comparison of two evaluations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from schemas.scores import MEASURES, ComparedFigures, Comparison, Difference, Figures, Measure, Scores, Verdict
from stages.evaluation.summary import mean_figures


def compare(before: Scores, after: Scores, origin: str) -> Comparison:
    """Compare the sequences that both evaluations have, and the means over these. `origin` names the earlier one."""
    old = {score.sequence: score for score in before.sequences}
    new = {score.sequence: score for score in after.sequences}
    shared = [name for name in new if name in old]
    means = (mean_figures([of[name] for name in shared]) for of in (old, new))
    return Comparison(
        before=origin,
        settings=tuple(changed_settings(before.config, after.config)),
        sequences=tuple(
            ComparedFigures(name=name, differences=differences(old[name].figures, new[name].figures)) for name in shared
        ),
        mean=ComparedFigures(name=f"mean of {len(shared)}", differences=differences(*means)) if shared else None,
        only_before=tuple(name for name in old if name not in new),
        only_after=tuple(name for name in new if name not in old),
    )


def differences(before: Figures, after: Figures) -> dict[str, Difference]:
    """The difference of every metric that both have."""
    found = {}
    for name, measure in MEASURES.items():
        old, new = getattr(before, name), getattr(after, name)
        if old is not None and new is not None:
            found[name] = Difference(before=old, after=new, verdict=verdict(measure, new - old))
    return found


def changed_settings(before: Any, after: Any, name: str = "") -> Iterator[str]:
    """The settings that differ, by dotted name."""
    if isinstance(before, dict) and isinstance(after, dict):
        for field in dict.fromkeys([*before, *after]):
            yield from changed_settings(before.get(field), after.get(field), f"{name}.{field}".lstrip("."))
    elif before != after:
        yield f"{name}: {before} -> {after}"


def verdict(measure: Measure, change: float) -> Verdict | None:
    """Judge a change by the measure's direction. A change below the shown decimals is neither better nor worse."""
    if measure.better is None:
        return None
    if abs(change) < 0.5 * 10**-measure.decimals:
        return "same"
    return "better" if (change > 0) == (measure.better == "higher") else "worse"
