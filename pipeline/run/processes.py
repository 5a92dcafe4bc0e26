"""Processes that end with the one that started them, and compute the same however many there are."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import resource
import signal
import sys

PR_SET_PDEATHSIG = 1

# Every numeric library gets one thread in every worker: then sums are added in the same order, so the
# results are the same, for any number of workers. Parallelism comes from tasks (sequences, candidates).
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def how_it_ended(code: int) -> str:
    """A process's return code in words."""
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def die_with_parent(parent: int) -> None:
    """Let the kernel kill this process when its parent, process `parent`, dies - even by kill -9.

    Linux only; elsewhere a process notices at its next word to the dead one that nobody listens.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it died before the kernel knew
        os._exit(1)


def die_with_forking_parent() -> None:
    """The same in a process that multiprocessing forked; nothing in any other."""
    parent = multiprocessing.parent_process()
    if parent is not None and parent.pid is not None:
        die_with_parent(parent.pid)


def peak_memory_mib() -> float:
    """The most memory that this process has held, in MiB; of a forked one, what it shares with its parent included."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10  # macOS counts in bytes
