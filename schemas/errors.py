"""The error that bad input ends in."""


class InputError(Exception):
    """Something the user gave cannot be used.

    The message is one line that names the file or field, what was found, what was expected and what to
    do. The command line prints it without a traceback and exits with code 2.
    """


class UnavailableError(InputError):
    """Input that this machine does not have, rather than wrong input; the message says how to get it."""
