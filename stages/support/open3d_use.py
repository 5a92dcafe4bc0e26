"""What takes Open3D, and says so where that cannot be loaded."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from schemas.errors import InputError
from stages.kernels.surfaces.open3d_library import Open3DError


@contextmanager
def needing_open3d(what: str) -> Iterator[None]:
    """Around what takes Open3D, or above its function. Raises InputError that begins with `what`."""
    try:
        yield
    except Open3DError as error:
        raise InputError(f"{what}: {error}") from error
