"""The start of `reart`: the command line takes a while to load, and Ctrl-C may come meanwhile."""

from __future__ import annotations

import sys


def main() -> None:
    """Load the command line and run it."""
    try:
        from pipeline.cli import app
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        sys.exit(130)
    app()
