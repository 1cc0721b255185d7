"""Child processes that a job's plug-in leaves running, and that must end with the job."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

_SET_CHILD_SUBREAPER = 36
"""Option of Linux's ``prctl``."""
_THREADS = Path("/proc/self/task")


def adopt_orphans() -> None:
    """Make this process the parent of descendants whose own parent ends, on Linux.

    Otherwise, process 1 would be their parent, and `end_children` would not find them.
    """
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def end_children() -> None:
    """Kill all child processes of this process, and wait until they have ended.

    After `adopt_orphans`, their own child processes end too. Only Linux lists child processes; on
    other systems, nothing happens.
    """
    while children := _children():
        for child in children:
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        for child in children:
            with suppress(ChildProcessError):  # waited for by another thread
                os.waitpid(child, 0)


def _children() -> set[int]:
    children: set[int] = set()
    for listed in _THREADS.glob("*/children"):
        with suppress(OSError):  # the thread has ended
            children.update(map(int, listed.read_text().split()))
    return children
