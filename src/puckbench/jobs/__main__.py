"""``python -m puckbench.jobs NAME RECORD.json key=FILE ...``: run one job."""

from __future__ import annotations

import sys

from puckbench.jobs.fork_server import run_forked

if __name__ == "__main__":
    status = run_forked(sys.argv[1:])
    if status is None:
        from puckbench.jobs.process import leave, main

        leave(main(sys.argv[1:]))
    sys.exit(status)
