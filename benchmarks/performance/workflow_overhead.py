"""Wall clock of a fresh run against the jobs' own work, and the time of each stage.

    python -m benchmarks.performance.workflow_overhead [CONFIG] [CORES]

Runs the workflow from nothing in a temporary folder. A job's own work is the life of its process,
from Snakemake's records; the overhead is what the run took over their sum shared by the cores.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]


def main() -> None:
    config = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "config" / "config.yaml").resolve()
    cores = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wall = run(folder, config, cores)
        stages = work(folder / ".snakemake" / "metadata")
    total = sum(seconds for _, seconds in stages.values())
    print(f"{'stage':16} {'jobs':>5} {'seconds':>9} {'each':>7}")
    for rule, (jobs, seconds) in sorted(stages.items(), key=lambda item: -item[1][1]):
        print(f"{rule:16} {jobs:5} {seconds:9.1f} {seconds / jobs:7.2f}")
    print(f"wall clock {wall:.1f} s; own work {total:.1f} s over {cores} cores;", end=" ")
    print(f"ratio {wall / (total / cores):.3f}")


def run(folder: Path, config: Path, cores: int) -> float:
    """Seconds of a fresh run in `folder`."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "workflow/Snakefile")]
    options = ["--configfile", str(config), "--cores", str(cores), "--quiet"]
    subprocess.run([*command, *options], cwd=folder, check=True)
    return time.perf_counter() - start


def work(records: Path) -> dict[str, tuple[int, float]]:
    """Rule to (jobs, seconds); a job has one record for each of its outputs."""
    jobs = {}
    for path in records.rglob("*"):
        if path.is_file():
            record = json.loads(path.read_text())
            jobs[record["rule"], *record["log"]] = record["endtime"] - record["starttime"]
    stages: dict[str, tuple[int, float]] = defaultdict(lambda: (0, 0.0))
    for (rule, *_), seconds in jobs.items():
        count, total = stages[rule]
        stages[rule] = (count + 1, total + seconds)
    return stages


if __name__ == "__main__":
    main()
