"""``python -m puckbench.steps NAME SETTINGS key=FILE ...``: run one step."""

from __future__ import annotations

import sys

from puckbench.core.interrupts import interrupt_with_run
from puckbench.steps.child import run_in_child
from puckbench.steps.fork_server import run_forked

_SECONDS_TO_END = 10
"""Time, in s, that this process has to end after it was interrupted."""


def _run(words: list[str]) -> int:
    interrupt_with_run(_SECONDS_TO_END)
    status = run_forked(words)
    return run_in_child(words) if status is None else status


if __name__ == "__main__":
    try:
        sys.exit(_run(sys.argv[1:]))
    except KeyboardInterrupt:  # before the step had begun
        print("puckbench: interrupted", file=sys.stderr)  # noqa: T201
        sys.exit(130)
