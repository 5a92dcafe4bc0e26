"""Export: a fitted model as a robot description that simulators load."""

from stages.export.mjcf import mjcf_files
from stages.export.robot import check_exportable, compute_export
from stages.export.urdf import urdf_files

WRITERS = {"urdf": urdf_files, "mjcf": mjcf_files}

__all__ = ["WRITERS", "check_exportable", "compute_export", "mjcf_files", "urdf_files"]
