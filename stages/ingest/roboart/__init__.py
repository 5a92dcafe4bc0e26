"""Data set `roboart`: sequences with ground truth, built from robot descriptions (supplement C)."""

from stages.ingest.roboart.builder import build_from_urdf
from stages.ingest.roboart.catalogue import robot_kind, robot_names, robot_split
from stages.ingest.roboart.descriptions import (
    ASSETS_VARIABLE,
    Description,
    description_digest,
    own_descriptions,
    robot_description,
)

__all__ = [
    "ASSETS_VARIABLE",
    "Description",
    "build_from_urdf",
    "description_digest",
    "own_descriptions",
    "robot_description",
    "robot_kind",
    "robot_names",
    "robot_split",
]
