"""The hostile inputs, by what they are."""

from __future__ import annotations

from attacks.case import Case
from attacks.lists import (
    arrays,
    clouds,
    descriptions,
    evaluations,
    frames,
    models,
    places,
    poses,
    scans,
    settings,
    streams,
    tables,
    training,
)

SUBJECTS = {
    "tables": tables,
    "arrays": arrays,
    "clouds": clouds,
    "scans": scans,
    "frames": frames,
    "settings": settings,
    "models": models,
    "poses": poses,
    "descriptions": descriptions,
    "evaluations": evaluations,
    "places": places,
    "streams": streams,
    "training": training,
}


def all_cases() -> dict[str, Case]:
    """Every case by `subject/name`."""
    return {f"{subject}/{case.name}": case for subject, module in SUBJECTS.items() for case in module.CASES}
