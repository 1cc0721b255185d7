"""Progress of a long command on standard error: a line that is rewritten, or one now and then."""

from __future__ import annotations

import sys
import time

# Into a file or a pipe goes a line every so many seconds, and none of what is done sooner.
_SECONDS_BETWEEN_LINES = 10.0


class Progress:
    """Tells how many of something are done, and when the rest will be."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._started = self._told = time.monotonic()

    def __call__(self, done: int, of: int) -> None:
        """Tell that `done` of `of` are done, if it is time to."""
        now, at_terminal = time.monotonic(), sys.stderr.isatty()
        if not at_terminal and now - self._told < _SECONDS_BETWEEN_LINES:
            return
        self._told = now
        left = (now - self._started) * (of - done) / done
        line = f"{self._what} {done:,} of {of:,}, {left:.0f} s left"
        if at_terminal:
            line = f"\r{line:60}" + ("\n" if done == of else "")
            print(line, end="", file=sys.stderr, flush=True)  # noqa: T201
        else:
            print(line, file=sys.stderr, flush=True)  # noqa: T201
