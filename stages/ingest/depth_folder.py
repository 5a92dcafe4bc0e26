"""A folder of depth images: depth/ with intrinsics, and masks, colours and camera poses where there are some.

- intrinsics.json or .txt: of all cameras; or intrinsics/CAMERA.json of each.
- depth/STATE.png: one image a frame; or depth/STATE/CAMERA.png, where several cameras see a state.
- mask/, color/ or rgb/: for each image another one of the same name.
- poses.txt or .npy: T_world_camera of all images; or poses/STATE/CAMERA.txt of each; or poses/CAMERA.txt of a camera
  that stands still.

Without poses, each frame is in the coordinates of its camera. Lengths are metres.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from schemas.config import DepthImagesConfig
from schemas.errors import InputError
from stages.ingest.formats.cloud import Cloud, Colours
from stages.ingest.formats.depth_images import (
    points_of,
    read_depth,
    read_mask,
    read_picture,
    read_pinhole,
    read_poses,
)
from stages.ingest.formats.disguises import disguise
from stages.ingest.listing import is_file, is_folder, visible_files, visible_folders
from stages.ingest.messages import TooLargeError, check_count, one_line, out_of_memory, too_large, unreadable
from stages.ingest.order import in_order
from stages.ingest.readers import Frame, check_frame_count, frame_files

_log = logging.getLogger("rearticulate.ingest")

DEPTH, MASKS, POSES, INTRINSICS = "depth", "mask", "poses", "intrinsics"
PICTURES = ("color", "rgb")
_DEPTHS = (".png", ".npy")
_MASKS = (".png", ".npy", ".bmp", ".tif", ".tiff")
_PICTURES = (".png", ".jpg", ".jpeg", ".webp")
_POSES = (".txt", ".npy")
_INTRINSICS = (".json", ".txt")
_APART = 0.02  # seconds at most between an image and its pose, as TUM associates them
_TIME = re.compile(r"[0-9]+(\.[0-9]+)?")


@dataclass(frozen=True)
class View:
    """One depth image: the frame and the camera that it is named by, and where the camera stood."""

    path: Path
    state: str
    camera: str
    T_world_camera: Float64[np.ndarray, "4 4"] | None = None


def is_depth_folder(folder: Path) -> bool:
    """Whether a folder holds depth images: with the cameras' intrinsics, or at least without other frames."""
    if not is_folder(folder / DEPTH):
        return False
    if _named(folder, INTRINSICS, _INTRINSICS) or is_folder(folder / INTRINSICS):
        return True
    inside = visible_files(folder / DEPTH)
    return any(file.suffix.lower() == ".png" for file in inside) and not frame_files(folder)


def depth_files(folder: Path) -> list[Path]:
    """All files that the frames of such a folder may depend on."""
    files = [*_named(folder, INTRINSICS, _INTRINSICS), *_named(folder, POSES, _POSES)]
    for inner in (DEPTH, MASKS, *PICTURES, POSES, INTRINSICS):
        if is_folder(folder / inner):
            files += visible_files(folder / inner)
            files += [file for below in visible_folders(folder / inner) for file in visible_files(below)]
    return files


def read_depth_frames(folder: Path, config: DepthImagesConfig, every: int, max_points: int) -> list[Frame]:
    """Read every `every`-th frame in the order of the names, in metres, with the viewpoints of its cameras.

    Raises InputError for images, masks, intrinsics or poses that are missing, damaged or do not fit each other, and for
    more than `max_points` pixels with depth.
    """
    views = _posed(folder, _views(folder))
    states = list(dict.fromkeys(view.state for view in views))
    check_frame_count(folder, len(states), every)
    most_views = max(sum(view.state == state for view in views) for state in states)
    frames, left = [], max_points
    for state in states[::every]:
        of_state = [view for view in views if view.state == state]
        clouds = []
        for view in of_state:
            with _reading(view.path, max_points):
                clouds.append(_cloud(folder, view, config, left))
            left -= len(clouds[-1].points)
        centres = [np.zeros(3) if view.T_world_camera is None else view.T_world_camera[:3, 3] for view in of_state]
        centres += centres[-1:] * (most_views - len(centres))  # every frame has as many, if need be the last one again
        points = np.concatenate([cloud.points for cloud in clouds])
        frames.append(Frame(f"{DEPTH}/{state}", points, np.stack(centres), _colours(clouds)))
    return frames


def declared_depth_frames(folder: Path) -> int:
    """How many frames such a folder holds: one for each image, or for each folder of images."""
    images = [file for file in visible_files(folder / DEPTH) if file.suffix.lower() in _DEPTHS]
    return len(images or visible_folders(folder / DEPTH))


def _views(folder: Path) -> list[View]:
    """The images in the order of the frames."""
    images = [file for file in visible_files(folder / DEPTH) if file.suffix.lower() in _DEPTHS]
    states = {below.name: below for below in visible_folders(folder / DEPTH)}
    if bool(images) == bool(states):
        found = "images and folders" if images else "neither images nor folders of them"
        raise InputError(
            f"{folder / DEPTH}: found {found}, expected one .png or .npy for each frame, "
            "or a folder of them for each frame; move the others away"
        )
    by_name = {file.name: file for file in images} or states
    order = in_order(list(by_name))
    if order.doubt:
        _log.warning("%s: %s", folder / DEPTH, order.message())
    views = []
    for name in order.names:
        files = [by_name[name]] if images else visible_files(by_name[name])
        for file in files:
            if file.suffix.lower() in _DEPTHS:
                stem = file.name[: -len(file.suffix)]
                views.append(View(file, stem if images else name, stem))
    names = [(view.state, view.camera) for view in views]
    if twice := next((view for view in views if names.count((view.state, view.camera)) > 1), None):
        raise InputError(f"{twice.path}: found an image of this name twice, expected one; move the other away")
    return views


def _posed(folder: Path, views: list[View]) -> list[View]:
    """The views with the poses of their cameras. Without poses, no frame may have several cameras."""
    if files := _named(folder, POSES, _POSES):
        (file,) = _only(files)
        with _reading(file):
            Ts, times = read_poses(file)
        chosen = _pose_of_each(file, views, times, len(Ts))
        return [replace(view, T_world_camera=Ts[index]) for view, index in zip(views, chosen, strict=True)]
    if is_folder(folder / POSES):
        return [replace(view, T_world_camera=_own_pose(_required(folder, POSES, view, _POSES))) for view in views]
    for before, view in pairwise(views):
        if before.state == view.state:
            raise InputError(
                f"{view.path}: found a second camera of the frame {view.state!r} without poses, expected where each "
                f"camera stood; add {POSES}.txt (docs/inputs.md)"
            )
    return views


def _pose_of_each(file: Path, views: Sequence[View], times: np.ndarray | None, count: int) -> list[int]:
    """The number of the pose of each view: by time where the images are named by it, else in their order."""
    if times is not None and all(_TIME.fullmatch(view.camera) for view in views):
        apart = np.abs(times - np.array([[float(view.camera)] for view in views]))
        if (apart.min(axis=1) <= _APART).all():
            return apart.argmin(axis=1).tolist()
    if count != len(views):
        by_time = "" if times is None else f", or within {_APART} s of the times in their names"
        raise InputError(
            f"{file}: found {count} poses of {len(views)} depth images, expected one each in order{by_time}; add them"
        )
    return list(range(count))


def _own_pose(file: Path) -> Float64[np.ndarray, "4 4"]:
    with _reading(file):
        Ts, _ = read_poses(file)
        if len(Ts) != 1:
            raise ValueError(f"found {len(Ts)} poses, expected one of this camera")
    pose: Float64[np.ndarray, "4 4"] = Ts[0]
    return pose


def _cloud(folder: Path, view: View, config: DepthImagesConfig, most: int) -> Cloud:
    """The points of an image's pixels with depth, in world coordinates, and their colours."""
    depth = read_depth(view.path, config.units_per_metre)
    seen = np.isfinite(depth) & (depth > 0)
    if config.farthest:
        seen &= depth <= config.farthest
    if is_folder(folder / MASKS):
        file = _required(folder, MASKS, view, _MASKS)
        with _reading(file):
            mask = read_mask(file)
            if mask.shape != depth.shape:
                raise ValueError(f"found a mask of shape {mask.shape} of an image of {depth.shape}, expected the same")
        seen &= mask
    strided = np.zeros_like(seen)
    strided[:: config.stride, :: config.stride] = seen[:: config.stride, :: config.stride]
    check_count(int(strided.sum()), most)
    file = _intrinsics(folder, view)
    with _reading(file):
        pinhole, size = read_pinhole(file)
    if size is not None and size != depth.shape[::-1]:
        raise ValueError(f"found an image of {depth.shape[1]} x {depth.shape[0]} pixels, but {file.name} is of {size}")
    points = points_of(depth, pinhole, strided)
    if view.T_world_camera is not None:
        points = points @ view.T_world_camera[:3, :3].T + view.T_world_camera[:3, 3]
    return Cloud(points, _picture_colours(folder, view, strided))


def _intrinsics(folder: Path, view: View) -> Path:
    """The file of all cameras' intrinsics, or that of the view's camera. Raises InputError if there is none."""
    if files := _only(_named(folder, INTRINSICS, _INTRINSICS)):
        return files[0]
    if not is_folder(folder / INTRINSICS):
        raise InputError(
            f"{folder}: found depth images without the camera's intrinsics, expected {INTRINSICS}.json (Open3D's) or "
            f"{INTRINSICS}.txt (fx fy cx cy) beside {DEPTH}; add it (docs/inputs.md)"
        )
    return _required(folder, INTRINSICS, view, _INTRINSICS)


def _picture_colours(folder: Path, view: View, seen: np.ndarray) -> Colours | None:
    """The colours of the seen pixels; None, with a warning, where the picture is missing or of another size."""
    for inner in PICTURES:
        if not is_folder(folder / inner):
            continue
        file = _find(folder / inner, view, _PICTURES)
        if file is None:
            _log.warning("%s: found no picture of this name in %s, so that colours are left out", view.path, inner)
            return None
        with _reading(file):
            pixels = read_picture(file)
        if pixels.shape[:2] == seen.shape:
            return pixels[seen]
        _log.warning("%s: %s has another size than its depth, so that colours are left out", view.path, inner)
    return None


def _colours(clouds: Sequence[Cloud]) -> Colours | None:
    colours = [cloud.colours for cloud in clouds if cloud.colours is not None]
    return np.concatenate(colours) if len(colours) == len(clouds) else None


def _required(folder: Path, inner: str, view: View, suffixes: Sequence[str]) -> Path:
    """The file of a view in a folder. Raises InputError if it is missing."""
    if (file := _find(folder / inner, view, suffixes)) is None:
        raise InputError(
            f"{view.path}: found nothing of its name in {folder / inner}, expected {view.camera}{suffixes[0]} "
            "or the like; add it or leave the image out"
        )
    return file


def _find(base: Path, view: View, suffixes: Sequence[str]) -> Path | None:
    """The file of a view: of its frame and camera, or of its camera alone."""
    places = [base / view.state / view.camera, base / view.camera]
    endings = [*suffixes, *(suffix.upper() for suffix in suffixes)]
    return next((file for place in places for ending in endings if is_file(file := Path(f"{place}{ending}"))), None)


def _named(folder: Path, stem: str, suffixes: Sequence[str]) -> list[Path]:
    return [file for suffix in suffixes if is_file(file := folder / f"{stem}{suffix}")]


def _only(files: list[Path]) -> list[Path]:
    if len(files) > 1:
        raise InputError(f"{files[0]}: found {files[1].name} beside it, expected one of them; move the other away")
    return files


@contextmanager
def _reading(path: Path, max_points: int = 0) -> Iterator[None]:
    """Turn what a file's reader raises into one line that names the file."""
    try:
        yield
    except InputError:
        raise
    except TooLargeError as error:
        raise too_large(path, error, max_points) from error
    except MemoryError as error:
        raise out_of_memory(path) from error
    except OSError as error:
        raise unreadable(path, error) from error
    except ValueError as error:
        reason = disguise(path) or one_line(error)
        raise InputError(f"{path}: {reason}{'' if '; ' in reason else '; correct it or save it anew'}") from error
