"""Progress of a long command on standard error: a line that is rewritten, or one now and then."""

from __future__ import annotations

import sys
import time

# Into a file or a pipe a line is written at this interval, and none for shorter work.
_SECONDS_BETWEEN_LINES = 10.0


class Progress:
    """Prints how many of a number of steps are done, and the time that the others will take."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._started = self._printed = time.monotonic()

    def __call__(self, done: int, of: int) -> None:
        """Print that `done` of `of` steps are done, unless a line was printed a moment ago."""
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
