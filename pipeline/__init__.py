"""When and where: tasks, artifact store, presets and the command line. No numerics."""

import sys

try:
    import fcntl as fcntl
except ImportError:  # what else is missing there would only be told later
    print(f"error: found {sys.platform}, expected Linux or macOS; on Windows run it inside WSL", file=sys.stderr)
    raise SystemExit(2) from None
