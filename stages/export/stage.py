"""Export: a fitted model as a robot description that simulators load."""

from stages.export.mjcf import mjcf_files
from stages.export.robot import check_exportable, describe
from stages.export.urdf import urdf_files

WRITERS = {"urdf": urdf_files, "mjcf": mjcf_files}

__all__ = ["WRITERS", "check_exportable", "describe", "mjcf_files", "urdf_files"]
