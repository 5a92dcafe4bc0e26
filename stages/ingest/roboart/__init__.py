"""Dataset `roboart`: sequences with ground truth, built from robot descriptions (the supplement's C)."""

from stages.ingest.roboart.builder import build_from_urdf, build_sequence
from stages.ingest.roboart.catalogue import robot_digest, robot_names

__all__ = ["build_from_urdf", "build_sequence", "robot_digest", "robot_names"]
