"""Reading back what a fit wrote: model.json and model.npz in one folder."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from schemas.errors import InputError
from schemas.model_file import ModelFile, Result

ARRAYS = ("canonical_points", "labels", "T_frame_canonical")


def read_model_folder(folder: Path) -> Result:
    """The model in a folder that `reart fit` or the result stage wrote.

    Raises InputError where a file is missing, unreadable or not a model of this version.
    """
    json_path, npz_path = folder / "model.json", folder / "model.npz"
    for path in (json_path, npz_path):
        if not path.is_file():
            raise InputError(f"{path}: not found, expected a folder with model.json and model.npz; check the path")
    try:
        model = ModelFile.model_validate_json(json_path.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, first["loc"])) or "the file"
        raise InputError(f"{json_path}: {field}: {first['msg']}; expected a model of version 1, fit it anew") from error
    try:
        with np.load(npz_path, allow_pickle=False) as arrays:
            loaded = {name: arrays[name] for name in ARRAYS}
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{npz_path}: unreadable ({error}); expected {', '.join(ARRAYS)}; fit the model anew"
        ) from error
    try:
        return Result(model=model, **loaded)
    except ValidationError as error:
        raise InputError(f"{npz_path}: {error.errors()[0]['msg']}; fit the model anew") from error
