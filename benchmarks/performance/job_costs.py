"""Memory and processor time of every kind of job of a finished run, from the logs of its jobs.

    python -m benchmarks.performance.job_costs [FOLDER_OF_THE_RUN]

Prints for each job and codec how many there were, and the most MiB and the most seconds of one.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

from puckbench.planning.job_times import read_job_times


def main() -> None:
    kinds = defaultdict(list)
    for time in read_job_times(Path(*sys.argv[1:2])):
        kinds[f"{time.job} {time.codec}".rstrip()].append(time)
    print(f"{'job':32} {'jobs':>5} {'most MiB':>9} {'most s':>7}")
    for kind, times in sorted(kinds.items()):
        most_mib, most_s = max(time.peak_mib for time in times), max(t.seconds for t in times)
        print(f"{kind:32} {len(times):5} {most_mib:9} {most_s:7.1f}")


if __name__ == "__main__":
    main()
