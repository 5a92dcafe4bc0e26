"""The pipeline around the stages: tasks, artifact store, presets and command line. It holds no numerics."""

import sys

try:
    import fcntl as fcntl
except ImportError:  # other missing modules would only be noticed later
    print(f"error: found {sys.platform}, expected Linux or macOS; on Windows run it inside WSL", file=sys.stderr)
    raise SystemExit(2) from None
