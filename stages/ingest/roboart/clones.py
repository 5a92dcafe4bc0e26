"""Robot descriptions from public repositories, cloned by robot_descriptions into its cache."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from functools import cache
from importlib import util
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import getproxies

LIBRARY = "robot_descriptions"
HOST = ("github.com", 443)
CONNECT_SECONDS = 3.0
CLONE_SECONDS = 900.0

# importing a description clones its repository and prints; so it runs in a separate process and prints the answer last
_PROGRAM = (
    "import importlib, json, sys; found = importlib.import_module(sys.argv[1]); "
    "print(json.dumps([found.URDF_PATH, found.PACKAGE_PATH]))"
)


class CloneError(Exception):
    """A description cannot be cloned. The message gives the reason in a few words."""


def clone_description(module: str) -> tuple[Path, tuple[Path, ...]]:
    """The URDF file and the mesh folders of a description, which is cloned on first use.

    Raises CloneError if robot_descriptions is not installed, or if there is no earlier clone and the host cannot be
    reached within seconds.
    """
    if util.find_spec(LIBRARY) is None:
        raise CloneError(f"the package {LIBRARY}, which clones it, is not installed")
    online = _online()
    environment = os.environ | {"GIT_TERMINAL_PROMPT": "0"} | ({} if online else {"GIT_ALLOW_PROTOCOL": "file"})
    command = [sys.executable, "-c", _PROGRAM, f"{LIBRARY}.{module}_description"]
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=CLONE_SECONDS, stdin=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired as error:
        raise CloneError(f"{LIBRARY} did not clone it within {CLONE_SECONDS:g} s") from error
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1][:200]
        raise CloneError(f"{LIBRARY} cannot clone it: {last if online else f'{HOST[0]} is out of reach'}")
    urdf_path, package = map(Path, json.loads(done.stdout.splitlines()[-1]))
    return urdf_path, (package.parent, package)


@cache
def _online() -> bool:
    """Whether the host, or the proxy to it, accepts connections. git itself would wait for minutes."""
    proxy = urlsplit(getproxies().get("https", ""))
    address = (proxy.hostname, proxy.port or HOST[1]) if proxy.hostname else HOST
    try:
        socket.create_connection(address, CONNECT_SECONDS).close()
    except OSError:
        return False
    return True
