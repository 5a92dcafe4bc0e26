"""How a long stage says where it is."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called with the steps done, the steps in all and, where there is one, the current energy."""

    def __call__(self, done: int, total: int, energy: float | None = None) -> None: ...


def silent(done: int, total: int, energy: float | None = None) -> None:
    """Progress that nobody watches."""
