"""Interruption of a run: all processes that `puckbench run` started end when it ends.

`puckbench run` starts Snakemake with a pipe as standard input, which Snakemake's jobs inherit.
Nothing is written to the pipe. When `puckbench run` ends, even by SIGKILL, the kernel closes the
pipe, and sends the signal SIGIO to each process that called `interrupt_with_run`.
"""

from __future__ import annotations

import os
import select
import signal
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

VARIABLE = "PUCKBENCH_RUN"
"""Environment variable with the inode number of the pipe of `puckbench run`.

A job compares it with its standard input, to know whether that is the pipe.
"""
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt in a `with` block, as SIGINT (Ctrl-C) does.

    A signal for which the process has set its own handler keeps this handler. Outside the main
    thread, nothing changes.
    """
    ending = [each for each in _SIGNALS if signal.getsignal(each) is signal.SIG_DFL]
    try:
        for each in ending:
            signal.signal(each, signal.default_int_handler)
    except ValueError:  # in another thread than the main one
        ending = []
    try:
        yield
    finally:
        for each in ending:
            signal.signal(each, signal.SIG_DFL)


def run_environment(pipe: int) -> dict[str, str]:
    """Return the environment variables for processes that inherit the pipe of `puckbench run`.

    `pipe` is the file descriptor of the pipe's end that becomes their standard input.
    """
    return {**os.environ, VARIABLE: str(os.fstat(pipe).st_ino)}


def interrupt_with_run(seconds_to_end: int = 0) -> None:
    """From now on, raise KeyboardInterrupt in this process if it is interrupted or its run ends.

    It is raised only at the first such event. Signals that this process ignores already, such as
    SIGHUP after ``nohup``, stay ignored.

    Parameters
    ----------
    seconds_to_end
        Time, in s, between KeyboardInterrupt and the end of the process by the kernel; 0 for no
        such end.
    """
    heard = [each for each in _SIGNALS if signal.getsignal(each) is not signal.SIG_IGN]
    pipes: list[int] = []

    def interrupt(*_: object) -> NoReturn:
        for each in (*heard, signal.SIGIO):
            signal.signal(each, lambda *_: None)
        for pipe in pipes:
            os.close(pipe)  # which would signal again
        signal.alarm(seconds_to_end)
        raise KeyboardInterrupt

    for each in (*heard, signal.SIGIO):
        signal.signal(each, interrupt)
    if sys.platform == "linux" and _is_pipe_of_run():
        # Opened again, since processes that share a file description share its owner, too.
        pipes.append(os.open("/proc/self/fd/0", os.O_RDONLY))
        signal_end(pipes[0])


def _is_pipe_of_run() -> bool:
    try:
        status = os.fstat(0)
    except OSError:  # closed
        return False
    return stat.S_ISFIFO(status.st_mode) and os.environ.get(VARIABLE) == str(status.st_ino)


def signal_end(stream: int) -> None:
    """Have SIGIO sent to this process when the other end of a pipe or socket closes.

    `stream` is the file descriptor of this process's end.
    """
    import fcntl

    fcntl.fcntl(stream, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(stream, fcntl.F_SETFL, os.O_ASYNC)
    if select.select([stream], [], [], 0)[0]:  # it has closed before
        signal.raise_signal(signal.SIGIO)
