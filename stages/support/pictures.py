"""matplotlib, which draws pictures into memory here: the user's own settings of it neither change nor stop them."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def _without(variable: str) -> Iterator[None]:
    """The environment without a variable, for a while."""
    value = os.environ.pop(variable, None)
    try:
        yield
    finally:
        if value is not None:
            os.environ[variable] = value


with _without("MPLBACKEND"):  # read by the import, which fails where it knows no such screen; there is none here
    import matplotlib
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Line3DCollection
    from mpl_toolkits.mplot3d.axes3d import Axes3D

matplotlib.use("Agg")
matplotlib.rcdefaults()

__all__ = ["Axes", "Axes3D", "Figure", "Line3DCollection", "colormaps", "picture_bytes"]


def picture_bytes(figure: Figure, kind: str, dpi: int) -> bytes:
    """A figure as the bytes of a png, svg or pdf file."""
    picture = io.BytesIO()
    figure.savefig(picture, format=kind, dpi=dpi, metadata={"Software": None} if kind == "png" else None)
    return picture.getvalue()
