"""Depth images with masks, colours, intrinsics and camera poses, each from one file.

Functions raise ValueError or OSError for files that cannot be used. Sizes are checked before pixels are unpacked.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float64, UInt8
from pydantic import BaseModel, ConfigDict, Field, PositiveInt, ValidationError

from schemas.artifact import GREATEST
from schemas.errors import first_fault
from stages.ingest.formats.arrays import map_array

MOST_PIXELS = 2**26  # of one image
_MOST_TEXT = 2**26  # bytes
_RIGID_TOLERANCE = 1e-3
_UNIT_TOLERANCE = 0.02  # of a quaternion's length; files hold few digits

Pinhole = tuple[float, float, float, float]
"""fx, fy, cx and cy of a camera, in pixels. The middle of the first pixel is at 0."""


def read_depth(path: Path, units_per_metre: float) -> Float64[np.ndarray, "rows columns"]:
    """Read a depth image in metres: a PNG of 16 bits of grey, or a .npy of real numbers (metres) or whole ones."""
    if path.suffix.lower() == ".npy":
        array = map_array(path)
        if array.ndim != 2 or array.dtype.kind not in "iuf":
            raise ValueError(
                f"found an array of shape {array.shape} of {array.dtype}, expected (rows, columns) of depth"
            )
        _check_size(*array.shape)
    else:
        array = _pixels(path, ("PNG",))
        if array.ndim != 2 or array.dtype.itemsize < 2:
            raise ValueError(
                "found an image of colours or of 8 bits, expected 16 bits of grey; "
                "save the depth itself, or as a .npy in metres"
            )
    depth: Float64[np.ndarray, "rows columns"] = np.asarray(array, dtype=np.float64)
    return depth if array.dtype.kind == "f" else depth / units_per_metre


def read_mask(path: Path) -> Bool[np.ndarray, "rows columns"]:
    """Read a mask: an image or .npy that is not 0, and not transparent, where the object is."""
    pixels = np.asarray(map_array(path)) if path.suffix.lower() == ".npy" else _pixels(path, ("PNG", "BMP", "TIFF"))
    if pixels.ndim == 3:
        seen: Bool[np.ndarray, "rows columns"] = (pixels[..., :3] != 0).any(axis=-1)
        return seen & (pixels[..., 3] != 0) if pixels.shape[-1] == 4 else seen
    if pixels.ndim != 2 or pixels.dtype.kind not in "biuf":
        raise ValueError(f"found an array of shape {pixels.shape} of {pixels.dtype}, expected (rows, columns)")
    return np.asarray(pixels != 0)


def read_picture(path: Path) -> UInt8[np.ndarray, "rows columns 3"]:
    """Read a picture's red, green and blue."""
    return _pixels(path, ("PNG", "JPEG", "WEBP"), "RGB")


def read_pinhole(path: Path) -> tuple[Pinhole, tuple[int, int] | None]:
    """Read a pinhole camera, and the size (columns, rows) of its images if the file tells it.

    A .json is Open3D's PinholeCameraIntrinsic. A text is TUM's `fx fy cx cy`, or a camera matrix (3, 3) or (4, 4).
    """
    if path.suffix.lower() == ".json":
        return _open3d_pinhole(path)
    rows = _table(path)
    if len(rows) == 1 and len(rows[0]) >= 4:
        numbers = rows[0]
        if any(numbers[4:]):
            raise ValueError(
                "found numbers of a distortion after fx fy cx cy; undistort the images, and leave them out"
            )
        return _checked(numbers[0], numbers[1], numbers[2], numbers[3]), None
    if len(rows) in (3, 4) and {len(row) for row in rows} == {len(rows)}:
        return _of_matrix(np.array(rows)), None
    raise ValueError(f"found {len(rows)} lines of numbers, expected one, fx fy cx cy, or a matrix of 3 x 3")


class _Open3D(BaseModel):
    """Open3D's PinholeCameraIntrinsic; its matrix is stored column by column."""

    model_config = ConfigDict(allow_inf_nan=False)

    intrinsic_matrix: Annotated[list[float], Field(min_length=9, max_length=9)]
    width: PositiveInt | None = None
    height: PositiveInt | None = None


def _open3d_pinhole(path: Path) -> tuple[Pinhole, tuple[int, int] | None]:
    try:
        found = _Open3D.model_validate(json.loads(_text(path)))
    except ValidationError as error:
        raise ValueError(
            f"{first_fault(error)}; expected Open3D's PinholeCameraIntrinsic, or fx fy cx cy as .txt"
        ) from error
    except RecursionError as error:
        raise ValueError("found JSON nested too deeply") from error
    matrix = np.array(found.intrinsic_matrix).reshape(3, 3)
    size = None if found.width is None or found.height is None else (found.width, found.height)
    return _of_matrix(matrix.T if not matrix[:2, 2].any() else matrix), size  # as others may store it, row by row


def _of_matrix(K: Float64[np.ndarray, "rows rows"]) -> Pinhole:
    rest = K.copy()
    rest[[0, 1, 0, 1], [0, 1, 2, 2]] = 0
    if (rest != np.diag([0, 0, *[1] * (len(K) - 2)])).any():
        raise ValueError("found a camera matrix that is not [fx 0 cx; 0 fy cy; 0 0 1]; correct it")
    return _checked(K[0, 0], K[1, 1], K[0, 2], K[1, 2])


def _checked(fx: float, fy: float, cx: float, cy: float) -> Pinhole:
    if not (0 < fx < GREATEST and 0 < fy < GREATEST and abs(cx) < GREATEST and abs(cy) < GREATEST):
        raise ValueError(f"found fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g}, expected numbers of pixels; correct them")
    return float(fx), float(fy), float(cx), float(cy)


def read_poses(path: Path) -> tuple[Float64[np.ndarray, "poses 4 4"], Float64[np.ndarray, "poses"] | None]:
    """Read T_world_camera of cameras that look along z with y downwards, and their times if the file tells them.

    Lines of a text are TUM's `time x y z qx qy qz qw`, or the 12 or 16 numbers of matrices, or the rows of matrices
    (4, 4) one below the other. A .npy holds (poses, 4, 4), or one (4, 4).
    """
    if path.suffix.lower() == ".npy":
        array = np.asarray(map_array(path))
        if array.dtype.kind not in "iuf" or array.shape[-2:] != (4, 4) or array.ndim > 3:
            raise ValueError(f"found an array of shape {array.shape} of {array.dtype}, expected (poses, 4, 4)")
        return _rigid(array.astype(np.float64).reshape(-1, 4, 4)), None
    rows = _table(path)
    width = len(rows[0]) if rows else 0
    if not rows or any(len(row) != width for row in rows):
        raise ValueError("found lines of different lengths or none, expected a pose a line")
    table = np.array(rows)
    if width == 8:
        return _of_quaternions(table), table[:, 0]
    if width == 4 and len(table) % 4 == 0:
        return _rigid(table.reshape(-1, 4, 4)), None
    if width in (12, 16):
        last = np.tile([0.0, 0, 0, 1], (len(table), 1))
        return _rigid((np.hstack([table, last]) if width == 12 else table).reshape(-1, 4, 4)), None
    raise ValueError(f"found lines of {width} numbers, expected time x y z qx qy qz qw, or matrices of 4 x 4")


def _of_quaternions(table: Float64[np.ndarray, "poses 8"]) -> Float64[np.ndarray, "poses 4 4"]:
    from scipy.spatial.transform import Rotation

    lengths = np.linalg.norm(table[:, 4:], axis=1)
    if not (np.abs(lengths - 1) < _UNIT_TOLERANCE).all():
        raise ValueError("found a quaternion that is not of unit length, expected qx qy qz qw; correct it")
    Ts = np.tile(np.eye(4), (len(table), 1, 1))
    Ts[:, :3, :3] = Rotation.from_quat(table[:, 4:]).as_matrix()
    Ts[:, :3, 3] = table[:, 1:4]
    return _rigid(Ts)


def _rigid(Ts: Float64[np.ndarray, "poses 4 4"]) -> Float64[np.ndarray, "poses 4 4"]:
    """Check transforms. Raises ValueError for others than [R p; 0 0 0 1]."""
    R = Ts[:, :3, :3]
    if not (
        (np.abs(Ts) < GREATEST).all()
        and (np.abs(R) < 2).all()
        and (np.abs(R @ R.swapaxes(1, 2) - np.eye(3)) < _RIGID_TOLERANCE).all()
        and (np.linalg.det(R) > 0).all()
        and (np.abs(Ts[:, 3] - [0, 0, 0, 1]) < _RIGID_TOLERANCE).all()
    ):
        raise ValueError(
            "found a matrix that is no rigid motion, expected [R p; 0 0 0 1] from camera to world; correct it"
        )
    return Ts


def points_of(
    depth: Float64[np.ndarray, "rows columns"], pinhole: Pinhole, seen: Bool[np.ndarray, "rows columns"]
) -> Float64[np.ndarray, "points 3"]:
    """The points of the seen pixels in the camera's coordinates: x to the right, y down, z forwards."""
    fx, fy, cx, cy = pinhole
    row, column = np.nonzero(seen)
    z = depth[row, column]
    return np.stack([(column - cx) / fx * z, (row - cy) / fy * z, z], axis=1)


def _pixels(path: Path, formats: tuple[str, ...], mode: str | None = None) -> np.ndarray:
    from PIL import Image

    try:
        with path.open("rb") as file, Image.open(file, formats=formats) as image:
            _check_size(image.height, image.width)
            return np.asarray(image if mode is None else image.convert(mode))
    except Image.DecompressionBombError as error:
        raise ValueError(f"found more pixels than {MOST_PIXELS:,}; make the image smaller") from error
    except (SyntaxError, Image.UnidentifiedImageError) as error:
        raise ValueError(f"found no image of the kinds {', '.join(formats)}; save it anew") from error
    except OSError as error:
        if error.errno is not None:
            raise
        raise ValueError(f"found a damaged image ({error}); save it anew") from error


def _check_size(rows: int, columns: int) -> None:
    if rows * columns > MOST_PIXELS:
        raise ValueError(f"found {columns} x {rows} pixels, expected at most {MOST_PIXELS:,}; make the image smaller")


def _text(path: Path) -> str:
    with path.open("rb") as file:
        data = file.read(_MOST_TEXT + 1)
    if len(data) > _MOST_TEXT:
        raise ValueError(f"found more than {_MOST_TEXT:,} bytes of text")
    return data.decode("utf-8-sig")


def _table(path: Path) -> list[list[float]]:
    """The numbers of a text by line, without comments. Blanks and commas separate them."""
    lines = [line.partition("#")[0].replace(",", " ").split() for line in _text(path).splitlines()]
    return [[float(word) for word in words] for words in lines if words]
