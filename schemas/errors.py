"""The error that bad input ends in, and what is said of a value that does not fit its schema."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from pydantic import ValidationError

LONGEST_NAME, LONGEST_FIELD, LONGEST_VALUE, LONGEST_FAULT = 80, 120, 40, 400  # characters shown
HUGE = 10**LONGEST_VALUE


class InputError(Exception):
    """Something the user gave cannot be used.

    The message is one line that names the file or field, what was found, what was expected and what to
    do. The command line prints it without a traceback and exits with code 2.
    """


class UnavailableError(InputError):
    """Input that this machine does not have, rather than wrong input; the message says how to get it."""


class Fault(NamedTuple):
    """One thing that a schema finds wrong: the dotted field, pydantic's name for the kind, the words, the value."""

    field: str
    kind: str
    said: str
    value: Any
    of_ours: bool  # said by a check of ours, not by pydantic

    @classmethod
    def first(cls, error: ValidationError) -> Fault:
        first = error.errors(include_url=False)[0]
        cause = first.get("ctx", {}).get("error")
        of_ours = isinstance(cause, Exception)  # of broken JSON it is a text
        said = str(cause) if of_ours else first["msg"]
        return cls(".".join(map(str, first["loc"])), first["type"], said, first["input"], of_ours)


def first_fault(error: ValidationError, within: str = "") -> str:
    """The first of a value's faults in one short line: the field, what is wrong, and what was found if that is short.

    `within` goes before the field, and stands for it where the whole is wrong. Our checks of a whole model name the
    field themselves.
    """
    fault = Fault.first(error)
    if fault.of_ours and not (fault.field and isinstance(fault.value, str | int | float | tuple | list)):
        return shortened(fault.said, LONGEST_FAULT)
    field = shortened(".".join(filter(None, [within, fault.field])), LONGEST_FIELD) or "the file"
    plain = fault.field and isinstance(fault.value, str | int | float) and not fault.said.startswith("found")
    found = f" (found {_brief(fault.value)})" if plain else ""
    return f"{field}: {shortened(fault.said, LONGEST_FAULT)}{found}"


def shortened(text: str, most: int) -> str:
    """The text in printable characters on one line, cut after `most`."""
    line = " ".join(text[: most + 1].split())
    line = "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in line)
    return line if max(len(text), len(line)) <= most else f"{line[:most]}..."


def quoted(text: str | None) -> str:
    """A name or a word of the user's, quoted, and cut where it is long."""
    return repr(text) if text is None or len(text) <= LONGEST_NAME else f"{text[:LONGEST_NAME]!r}..."


def _brief(value: str | int | float) -> str:
    """A value as it is written, if that is short."""
    if isinstance(value, int) and abs(value) > HUGE:
        return "a huge number"
    text = repr(value[: LONGEST_VALUE + 1] if isinstance(value, str) else value)
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}..."
