"""The command line: `reart`, one module a command."""

from __future__ import annotations

import errno
import sys
from typing import Any

import typer
from typer.core import TyperGroup

from pipeline.cli.evaluate import evaluate
from pipeline.cli.export import export
from pipeline.cli.figure import figure
from pipeline.cli.fit import fit
from pipeline.cli.inspect import inspect
from pipeline.cli.pose import pose
from pipeline.cli.rerun import rerun
from pipeline.cli.run import run
from pipeline.cli.status import status
from pipeline.cli.train_flow import train_flow
from pipeline.store import CorruptArtifactError
from schemas.errors import InputError


class OneLineErrors(TyperGroup):
    """What the user can put right ends in one line on standard error, never in a traceback."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except InputError as error:
            fail(error, 2)
        except CorruptArtifactError as error:
            fail(error, 1)
        except OSError as error:  # raised wherever such a path is first asked for
            if error.errno != errno.ENAMETOOLONG:
                raise
            fail(f"{str(error.filename)[:80]}...: found a name too long for this system; give a shorter one", 2)
        except KeyboardInterrupt:
            fail("interrupted; what was complete is kept, and the same command goes on from there", 130)


def fail(message: object, code: int) -> None:
    print("error:", " ".join(str(message).split()), file=sys.stderr)
    raise typer.Exit(code)


app = typer.Typer(
    name="reart",
    cls=OneLineErrors,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    help="From a sequence of point clouds of any articulated object to a model that moves again.",
)
for command in (fit, run, evaluate, status, inspect, rerun, figure, export, pose, train_flow):
    app.command()(command)
