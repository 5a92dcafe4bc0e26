"""Luigi with our settings alone. Import it from here.

On import, Luigi reads a luigi.cfg in the current folder, in /etc, and at a path from the environment. This module
imports it in a folder without such a file, and drops the settings that it found elsewhere.
"""

from __future__ import annotations

import contextlib
import os
import warnings
from pathlib import Path

for _name in ("LUIGI_CONFIG_PATH", "LUIGI_CONFIG_PARSER"):
    os.environ.pop(_name, None)
with contextlib.chdir(Path(__file__).parent), warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # Luigi's own warning about an unused setting
    import luigi as luigi
    import luigi.configuration
    import luigi.scheduler
    import luigi.worker
luigi.configuration.get_config().clear()
