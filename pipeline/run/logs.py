"""The log of a stage: all output of its process while it runs."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from pipeline.store.files import open_fresh

OUR_LOGGER = "rearticulate"


@contextlib.contextmanager
def captured(path: Path, on_warning: Callable[[str], None]) -> Iterator[None]:
    """Redirect standard output, standard error (also of C libraries) and all logging to a new file.

    Another process that writes a log at the same path keeps its own file. Warnings of our own loggers are for the user,
    so `on_warning` receives them as well. Raises OSError if the file cannot be made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    root = logging.getLogger()
    level = root.level
    with open_fresh(path) as log, contextlib.ExitStack() as stack:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        for descriptor in (1, 2):
            saved = os.dup(descriptor)
            stack.callback(os.close, saved)
            stack.callback(os.dup2, saved, descriptor)
            os.dup2(log.fileno(), descriptor)
        stack.enter_context(contextlib.redirect_stdout(log))
        stack.enter_context(contextlib.redirect_stderr(log))
        to_file = logging.StreamHandler(log)
        to_file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        for logger, handler in ((root, to_file), (logging.getLogger(OUR_LOGGER), _WarningHandler(on_warning))):
            logger.addHandler(handler)
            stack.callback(logger.removeHandler, handler)
        root.setLevel(logging.INFO)
        stack.callback(root.setLevel, level)
        yield


class _WarningHandler(logging.Handler):
    def __init__(self, on_warning: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self.on_warning = on_warning

    def emit(self, record: logging.LogRecord) -> None:
        self.on_warning(record.getMessage())
