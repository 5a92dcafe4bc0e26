"""What each stage computes: one module or package a stage, pure functions on schema objects."""

import contextlib
import os
import tempfile

# Importing torch's compiler, which nothing here uses, makes the folder of its cache. This one is there already.
with contextlib.suppress(FileNotFoundError):
    os.environ.setdefault("TORCHINDUCTOR_CACHE_DIR", tempfile.gettempdir())
