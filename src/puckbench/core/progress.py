from __future__ import annotations

import sys
import time

_SECONDS_BETWEEN_LINES = 10.0


class Progress:
    """Prints the number of finished steps and an estimate of the remaining time."""

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
