"""Dataset `roboart`: sequences with ground truth, built from robot descriptions (the supplement's C)."""

from stages.ingest.roboart.builder import build_from_urdf, build_sequence
from stages.ingest.roboart.catalogue import robot_kind, robot_names, robot_split
from stages.ingest.roboart.descriptions import ASSETS_VARIABLE, robot_digest

__all__ = [
    "ASSETS_VARIABLE",
    "build_from_urdf",
    "build_sequence",
    "robot_digest",
    "robot_kind",
    "robot_names",
    "robot_split",
]
