"""Processes that end with their parent, and whose results do not depend on their number."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import resource
import signal
import sys

PR_SET_PDEATHSIG = 1

# Every numeric library uses one thread in every worker. Sums are then added in the same order, so the results
# do not depend on the number of workers. Parallelism comes from tasks (sequences, candidates).
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def how_it_ended(code: int) -> str:
    """Describe a process's return code in words."""
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def die_with_parent(parent: int) -> None:
    """Let the kernel kill this process when its parent, process `parent`, dies, even by kill -9.

    This works on Linux only. Elsewhere a process ends when it next writes to the pipe of its dead parent.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it died before the request took effect
        os._exit(1)


def die_with_forking_parent() -> None:
    """Do the same in a process that multiprocessing forked. Do nothing in any other."""
    parent = multiprocessing.parent_process()
    if parent is not None and parent.pid is not None:
        die_with_parent(parent.pid)


def peak_memory_mib() -> float:
    """The peak memory of this process in MiB. It includes memory that a forked process shares with its parent."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10  # macOS counts in bytes
