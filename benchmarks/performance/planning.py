"""Seconds and memory of planning the thesis at full size.

    python -m benchmarks.performance.planning [CONFIG]

Two dry runs, each in a process: config/thesis.yaml with stand-ins (996 clouds, five codecs at six
to eight rates), planned and no more (--quiet), and once more with every job and its reasons. Prints
jobs, processor and wall seconds, and peak memory.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from benchmarks.performance.rows import Inputs, Row

ROOT = Path(__file__).parents[2]
DRY = ("-n", "--cores", "2", "--quiet")
EACH = ("rules", "host", "reason")
"""Words after --quiet with which Snakemake goes through every job of a dry run, and prints none."""


class DryRun(NamedTuple):
    """Jobs, seconds of the processor and on the wall, and peak memory of a dry run."""

    name: str
    jobs: str
    processor_s: float
    wall_s: float
    mib: float


def main() -> None:
    config = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "config" / "thesis.yaml").resolve()
    print(f"{'':10} {'jobs':>7} {'cpu s':>7} {'wall s':>7} {'MiB':>6}")
    for name, jobs, processor_s, wall_s, mib in dry_runs(config):
        print(f"{name:10} {jobs:>7} {processor_s:7.1f} {wall_s:7.1f} {mib:6.0f}", flush=True)


def measure(inputs: Inputs) -> Iterator[Row]:
    config = "benchmarks/small.yaml" if inputs.is_trial else "config/thesis.yaml"
    for run in dry_runs(ROOT / config):
        what = f"{config}, {run.name}" + f" ({run.jobs} jobs)" * run.jobs.isdecimal()
        yield Row(f"{what}: time", run.processor_s, "processor s")
        yield Row(f"{what}: memory", run.mib, "MiB")


def dry_runs(config: Path) -> Iterator[DryRun]:
    words = [
        *("--snakefile", str(ROOT / "workflow" / "Snakefile")),
        *("--configfile", str(config), "--config", "stand_in=true"),
    ]
    with tempfile.TemporaryDirectory() as folder:
        yield dry_run(Path(folder), "planned", words)
        yield dry_run(Path(folder), "every job", [*EACH, *words])


def dry_run(folder: Path, name: str, words: list[str]) -> DryRun:
    command = [sys.executable, "-m", "snakemake", *DRY, *words]
    start = time.perf_counter()
    with (folder / "out.txt").open("w") as out:
        child = subprocess.Popen(command, cwd=folder, stdout=out, stderr=subprocess.STDOUT)
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = status
    text = (folder / "out.txt").read_text()
    if status:
        raise SystemExit(text[-2000:])
    total = re.search(r"^total +(\d+)$", text, re.MULTILINE)
    jobs = total.group(1) if total else "-"
    wall_s = time.perf_counter() - start
    return DryRun(name, jobs, used.ru_utime + used.ru_stime, wall_s, used.ru_maxrss / 1024)


if __name__ == "__main__":
    main()
