"""The process of the command line: its standard streams, current folder and signals."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from types import FrameType

from schemas.errors import InputError

ENDING = (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


class Ended(BaseException):
    """A signal asks this process to end. It is not an Exception, so that handlers of those let it pass."""

    def __init__(self, number: int) -> None:
        self.name, self.exit_code = signal.Signals(number).name, 128 + number
        super().__init__(self.name)


@contextlib.contextmanager
def answering_signals() -> Iterator[None]:
    """Raise `Ended` for signals that would kill this process, so that its children end and the cursor is restored.

    Ignored signals, as under nohup, stay ignored.
    """
    answered = [number for number in ENDING if signal.getsignal(number) is signal.SIG_DFL]

    def end(number: int, frame: FrameType | None) -> None:
        for other in answered:
            signal.signal(other, signal.SIG_IGN)  # no further signal interrupts the clean-up
        raise Ended(number)

    for number in answered:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in answered:
            signal.signal(number, signal.SIG_DFL)


def open_standard_streams() -> None:
    """Open closed standard streams. Otherwise the next opened file would take their number and receive the output.

    Characters that are not valid text, or that the terminal cannot show, are printed as backslash escapes.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, os.fdopen(number, "r" if number == 0 else "w", closefd=False))
        elif number and hasattr(getattr(sys, name), "reconfigure"):
            getattr(sys, name).reconfigure(errors="backslashreplace")


def close_output() -> None:
    """Flush standard output. Raises OSError if that fails, and then drops the rest so that it cannot fail again."""
    try:
        sys.stdout.flush()
    except OSError:
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise


def check_surroundings(words: Sequence[str]) -> None:
    """Raise InputError for arguments that are not valid text, or if the current folder is gone."""
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError as error:
            shown = word.encode("utf-8", "backslashreplace").decode()
            raise InputError(f"{shown}: found a name that is not UTF-8; rename it, or set LANG=C.UTF-8") from error
    try:
        os.getcwd()
    except OSError as error:
        raise InputError(f"the current folder: {error.strerror}; change to one that is there") from error
