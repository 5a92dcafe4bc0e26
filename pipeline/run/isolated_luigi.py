"""Luigi with nobody's settings but ours. Import it from here.

Luigi reads a luigi.cfg in the current folder, those in /etc and one named by the environment, as soon as
it is imported. Here it is imported from a folder that has none, and what it found elsewhere is dropped.
"""

from __future__ import annotations

import contextlib
import os
import warnings
from pathlib import Path

for _name in ("LUIGI_CONFIG_PATH", "LUIGI_CONFIG_PARSER"):
    os.environ.pop(_name, None)
with contextlib.chdir(Path(__file__).parent), warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of Luigi's own, about a setting that we do not use
    import luigi as luigi
    import luigi.configuration
    import luigi.scheduler
    import luigi.worker
luigi.configuration.get_config().clear()
