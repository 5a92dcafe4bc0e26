"""The error for bad input, and the description of a value that does not fit its schema."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from pydantic import ValidationError

LONGEST_NAME, LONGEST_FIELD, LONGEST_VALUE, LONGEST_FAULT = 80, 120, 40, 400  # in characters
HUGE = 10**LONGEST_VALUE


class InputError(Exception):
    """The user's input cannot be used.

    The message is one line. It names the file or field, what was found, what was expected and what to do. The command
    line prints it without a traceback and exits with code 2.
    """


class UnavailableError(InputError):
    """The input is missing on this machine rather than wrong. The message says how to get it."""


class Fault(NamedTuple):
    """One fault that a schema finds: the dotted field, pydantic's name of its kind, the message and the value."""

    field: str
    kind: str
    said: str
    value: Any
    of_ours: bool  # raised by our own check rather than by pydantic

    @classmethod
    def first(cls, error: ValidationError) -> Fault:
        first = error.errors(include_url=False)[0]
        cause = first.get("ctx", {}).get("error")
        of_ours = isinstance(cause, Exception)  # for broken JSON it is a text
        said = str(cause) if of_ours else first["msg"]
        return cls(".".join(map(str, first["loc"])), first["type"], said, first["input"], of_ours)


def first_fault(error: ValidationError, within: str = "") -> str:
    """Describe the first fault in one short line: the field, what is wrong, and the value if that is short.

    `within` is a prefix of the field's name. It replaces the name when the fault concerns the whole value. Our own
    checks of a whole model name the field themselves.
    """
    fault = Fault.first(error)
    if fault.of_ours and not (fault.field and isinstance(fault.value, str | int | float | tuple | list)):
        return shortened(fault.said, LONGEST_FAULT)
    field = shortened(".".join(filter(None, [within, fault.field])), LONGEST_FIELD) or "the file"
    plain = fault.field and isinstance(fault.value, str | int | float) and not fault.said.startswith("found")
    found = f" (found {_brief(fault.value)})" if plain else ""
    return f"{field}: {shortened(fault.said, LONGEST_FAULT)}{found}"


def shortened(text: str, most: int) -> str:
    """Put a text on one line in printable characters, at most `most` of them."""
    line = " ".join(text[: most + 1].split())
    line = "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in line)
    return line if max(len(text), len(line)) <= most else f"{line[:most]}..."


def quoted(text: str | None) -> str:
    """Quote a name or a word from the user, cut if it is long."""
    return repr(text) if text is None or len(text) <= LONGEST_NAME else f"{text[:LONGEST_NAME]!r}..."


def _brief(value: str | int | float) -> str:
    """The value as written, if that is short."""
    if isinstance(value, int) and abs(value) > HUGE:
        return "a huge number"
    text = repr(value[: LONGEST_VALUE + 1] if isinstance(value, str) else value)
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}..."
