"""``python -m puckbench.jobs NAME RECORD.json key=FILE ...``: run one job."""

from __future__ import annotations

import sys

from puckbench.core.interrupts import interrupt_with_run
from puckbench.jobs.fork_server import run_forked

_SECONDS_TO_END = 10
"""Time (s) between interrupting this process and its end."""

if __name__ == "__main__":
    interrupt_with_run(_SECONDS_TO_END)
    status = run_forked(sys.argv[1:])
    if status is None:
        from puckbench.jobs.process import leave, main

        leave(main(sys.argv[1:]))
    sys.exit(status)
