"""What commands print: their answers, and the progress of long work."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

from pointkit.files import unwritable

_SECONDS_BETWEEN_LINES = 10.0


class Progress:
    """Prints how much of some work is done, and an estimate of the remaining time.

    Call the object with the numbers of finished and of all steps. At a terminal, it rewrites one
    line of standard error; elsewhere, it adds a line every ten seconds.

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


def print_answer(text: str) -> None:
    """Print a command's answer on standard output.

    Raises
    ------
    InputError
        Standard output cannot be written (disk full). A reader that closed its pipe is no error.
    """
    try:
        print(text)  # noqa: T201
        sys.stdout.flush()
    except OSError as error:
        # The interpreter flushes the remaining text at its end, which would fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            raise unwritable(Path("standard output"), error) from error
