"""The sequences of the data set: several people for every kind of motion, and the split for testing."""

from __future__ import annotations

from typing import Literal

from stages.ingest.humans.motions import KINDS

Split = Literal["train", "test"]

EDITION = 1  # raise it when names come to mean other sequences
_PEOPLE = (1, 2, 3)
_JUDGES = 3  # the person of each kind whose sequence is only used for testing


def human_names() -> list[str]:
    """The names of all sequences, such as walk-1: a kind of motion and the number of a person of that kind."""
    return [f"{kind}-{person}" for kind in KINDS for person in _PEOPLE]


def human_kind(name: str) -> str:
    """The kind of motion of a sequence."""
    return name.rpartition("-")[0]


def human_split(name: str) -> Split:
    """The split: `test` has ten sequences, one of each kind; settings are tuned on `train`, all others."""
    return "test" if name.endswith(f"-{_JUDGES}") else "train"
