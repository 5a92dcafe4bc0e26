"""The sequences of the data set: every kind of motion by several people, and which of them judge."""

from __future__ import annotations

from typing import Literal

from stages.ingest.humans.motions import KINDS

Split = Literal["train", "test"]

EDITION = 1  # rises where a name comes to mean another sequence
_PEOPLE = (1, 2, 3)
_JUDGES = 3  # the person of each kind whose sequence is never tuned on


def human_names() -> list[str]:
    """All sequences, as in walk-1: a kind of motion and a person, who is another one in each sequence."""
    return [f"{kind}-{person}" for kind in KINDS for person in _PEOPLE]


def human_kind(name: str) -> str:
    """The kind of motion of a sequence."""
    return name.rpartition("-")[0]


def human_split(name: str) -> Split:
    """`test`, the ten sequences that judge, one of each kind; or `train`, those that settings are tuned on."""
    return "test" if name.endswith(f"-{_JUDGES}") else "train"
