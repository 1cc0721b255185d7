"""The child process in which a job runs if no server forks it.

A codec or another plug-in may end the process of its job, kill it, or leave processes running. The
parent process tells in the job's log how the job ended, and ends what it left.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import time
from collections.abc import Sequence
from typing import NoReturn

from puckbench.core.children import adopt_orphans, end_children
from puckbench.core.interrupts import signal_end

EXIT_STATUS = "exit status "
"""Beginning of the last line in the log of a job that ended its process itself (`os._exit`)."""
KILLED = "killed by signal "
"""Beginning of the last line in the log of a job that a signal killed."""
SECONDS_TO_END = 5.0
"""Time (s) between interrupting a job and killing it."""
INTERRUPTED = 130
"""Exit status of a job that was interrupted."""


def run_in_child(words: Sequence[str]) -> int:
    """Run a job in a child process, and return its exit status.

    Parameters
    ----------
    words
        The arguments of ``python -m puckbench.steps``.
    """
    if sys.platform != "linux":
        _run(words)
    adopt_orphans()
    here, there = socket.socketpair()
    job = os.fork()
    if job == 0:
        here.close()
        signal_end(there.fileno())  # of the parent process, with which this one is interrupted
        _run(words, there)
    try:
        _, status = os.waitpid(job, 0)
    except KeyboardInterrupt:
        os.kill(job, signal.SIGINT)
        _wait_or_kill(job)
        return INTERRUPTED
    finally:
        end_children()
    here.setblocking(False)
    return exit_status(os.waitstatus_to_exitcode(status), has_returned=_has_message(here))


def exit_status(status: int, *, has_returned: bool) -> int:
    """Return the exit status for a job's process, and print how it ended if the job did not return.

    Parameters
    ----------
    status
        Exit status of the process, or minus the number of the signal that ended it.
    has_returned
        Whether the job came to its end, and printed what failed.
    """
    if status < 0:
        print(f"{KILLED}{-status} ({_signal_name(-status)})", file=sys.stderr)  # noqa: T201
        return 128 - status
    if not has_returned:
        print(f"{EXIT_STATUS}{status}", file=sys.stderr)  # noqa: T201
        return status or 1
    return status


def _run(words: Sequence[str], parent: socket.socket | None = None) -> NoReturn:
    from puckbench.steps.process import leave, main

    try:
        status = main(words, is_alone=True)
    except (OSError, ValueError):  # of standard error, which a plug-in has closed
        os._exit(1)
    if parent:
        parent.send(b"returned")
    leave(status)


def _has_message(here: socket.socket) -> bool:
    try:
        return bool(here.recv(1))
    except BlockingIOError:
        return False


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return "unknown"


def _wait_or_kill(job: int) -> None:
    until = time.monotonic() + SECONDS_TO_END
    while os.waitpid(job, os.WNOHANG) == (0, 0):
        if time.monotonic() > until:
            os.kill(job, signal.SIGKILL)
        time.sleep(0.02)
