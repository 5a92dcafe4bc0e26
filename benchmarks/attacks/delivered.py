"""What a fit delivers, and what notices where that is not as it was written."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pipeline.results.delivery import check_delivery
from pipeline.results.model_folder import read_model_folder
from schemas.errors import InputError

DELIVERED = (
    "delivered.json",
    "model.json",
    "model.npz",
    "robot.urdf",
    "robot.xml",
    "meshes/*.stl",
    "report.html",
    "metrics.json",
)


def delivered_problem(folder: Path) -> str:
    """The first thing that the product finds wrong with a delivered folder; empty where it finds nothing."""
    try:
        if problems := check_delivery(folder):
            return problems[0]
        read_model_folder(folder)
    except InputError as error:
        return str(error)
    return ""


def whole(name: str, content: bytes) -> bool:
    """Whether a delivered file is one from its beginning to its end, whichever fit wrote it."""
    try:
        match Path(name).suffix:
            case ".json":
                json.loads(content)
            case ".npz":
                with np.load(io.BytesIO(content)) as arrays:
                    for array in arrays.files:
                        arrays[array]
            case ".urdf" | ".xml":
                ElementTree.fromstring(content)
            case ".stl":
                return len(content) >= 84 and len(content) == 84 + 50 * struct.unpack("<I", content[80:84])[0]
            case ".html":
                return content.rstrip().endswith(b"</html>")
    except Exception:
        return False
    return True
