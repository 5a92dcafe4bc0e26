"""The command line `reart`, with one module for each command."""

from __future__ import annotations

import contextlib
import errno
import importlib.metadata
import sys
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from pipeline.cli.evaluate import evaluate
from pipeline.cli.export import export
from pipeline.cli.figure import figure
from pipeline.cli.fit import fit
from pipeline.cli.inspect import inspect
from pipeline.cli.pose import pose
from pipeline.cli.process import Ended, answering_signals, check_surroundings, close_output, open_standard_streams
from pipeline.cli.rerun import rerun
from pipeline.cli.run import run
from pipeline.cli.settings import settings
from pipeline.cli.status import status
from pipeline.cli.train_flow import train_flow
from pipeline.run.failures import one_line
from pipeline.store.artifacts import ArtifactError
from schemas.errors import InputError

OF_A_FILE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
KEPT = "what was complete is kept, and the same command goes on from there"


class OneLineErrors(TyperGroup):
    """Report errors that the user can correct in one line on standard error, without a traceback."""

    def main(self, args: Sequence[str] | None = None, *rest: Any, **more: Any) -> Any:
        open_standard_streams()
        with _as_exit_codes(), answering_signals():
            check_surroundings(sys.argv[1:] if args is None else args)
            try:
                return super().main(args, *rest, **more)
            finally:
                close_output()

    def invoke(self, ctx: Any) -> Any:
        with _as_exit_codes():  # before Typer handles some of them itself
            return super().invoke(ctx)


@contextlib.contextmanager
def _as_exit_codes() -> Iterator[None]:
    try:
        yield
    except InputError as error:
        _end(one_line(error), 2)
    except typer.BadParameter as error:
        _end(error.format_message(), 2)
    except ArtifactError as error:
        _end(one_line(error), 1)
    except OSError as error:
        if error.errno == errno.EPIPE:
            sys.exit(1)  # the reader of the pipe is gone
        if error.filename is None and error.errno in OF_A_FILE:
            error.filename = "standard output"  # errors of all other files name them already
        _end(one_line(error), 2 if error.errno == errno.ENAMETOOLONG else 1)
    except MemoryError as error:
        _end(one_line(error), 1)
    except KeyboardInterrupt:
        _end(f"interrupted; {KEPT}", 130)
    except Ended as ended:
        _end(f"ended by {ended.name}; {KEPT}", ended.exit_code)


def _end(message: str, code: int) -> None:
    with contextlib.suppress(OSError):  # the terminal may be gone
        print("error:", message, file=sys.stderr)
    sys.exit(code)


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"rearticulate {importlib.metadata.version('rearticulate')}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """From a sequence of point clouds of any articulated object to a model that moves again."""


app = typer.Typer(
    name="reart",
    cls=OneLineErrors,
    callback=_options,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (fit, run, evaluate, status, inspect, rerun, figure, export, pose, settings, train_flow):
    app.command()(command)
