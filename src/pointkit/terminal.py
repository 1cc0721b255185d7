"""Output of commands: answers, and the progress of long work."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

from pointkit.files import unwritable

PIPE = Path("-")
"""Path that stands for standard input or standard output in commands that take pipes."""
_SECONDS_BETWEEN_LINES = 10.0


class Progress:
    """Prints the progress of some work, with an estimate of the remaining time.

    Call the object with the number of finished steps and the number of all steps. At a terminal, it
    rewrites one line of standard error; otherwise, it adds a line every ten seconds.

    Parameters
    ----------
    what
        Noun for a step in the printed line, such as ``frame``.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._started = self._printed = time.monotonic()

    def __call__(self, done: int, of: int) -> None:
        now, at_terminal = time.monotonic(), sys.stderr.isatty()
        if not at_terminal and now - self._printed < _SECONDS_BETWEEN_LINES:
            return
        self._printed = now
        left = (now - self._started) * (of - done) / done
        line = f"{self._what} {done:,} of {of:,}, {left:.0f} s left"
        if at_terminal:
            line = f"\r{line:60}" + ("\n" if done == of else "")
            print(line, end="", file=sys.stderr, flush=True)  # noqa: T201
        else:
            print(line, file=sys.stderr, flush=True)  # noqa: T201


def print_answer(text: str, out: Path | None = None) -> None:
    """Print the answer of a command on standard output.

    Parameters
    ----------
    text
        The answer.
    out
        File that the command wrote. If it is `PIPE`, standard output has the file's content, and
        the answer goes to standard error.

    Raises
    ------
    InputError
        Standard output cannot be written, e.g. because a disk is full. A reader that closes a pipe
        early causes no error.
    """
    try:
        print(text, file=sys.stderr if out == PIPE else None, flush=True)
    except OSError as error:
        # The interpreter flushes the remaining text at its end, which would fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            raise unwritable(Path("standard output"), error) from error
