"""Open3D, imported where it is needed first: that takes a second, and fails on some machines."""

from __future__ import annotations

from typing import Any


class Open3DError(ImportError):
    """Open3D cannot be loaded. The message is one line with the cause and a remedy."""


def load_open3d() -> Any:
    """The module. Raises Open3DError."""
    try:
        import open3d
    except MemoryError:
        raise
    except Exception as error:  # a missing system library is an OSError, one built for another numpy anything
        cause = " ".join(str(error).split())[:300].rstrip(".") or type(error).__name__
        raise Open3DError(f"Open3D cannot be loaded here ({cause}); mend its installation") from error
    return open3d
