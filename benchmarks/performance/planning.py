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
from pathlib import Path

ROOT = Path(__file__).parents[2]
DRY = ("-n", "--cores", "2", "--quiet")
EACH = ("rules", "host", "reason")
"""Words after --quiet with which Snakemake goes through every job of a dry run, and prints none."""


def main() -> None:
    config = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "config" / "thesis.yaml").resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = [
            *("--snakefile", str(ROOT / "workflow" / "Snakefile")),
            *("--configfile", str(config), "--config", "stand_in=true"),
        ]
        print(f"{'':10} {'jobs':>7} {'cpu s':>7} {'wall s':>7} {'MiB':>6}")
        dry_run(folder, "planned", words)
        dry_run(folder, "every job", [*EACH, *words])


def dry_run(folder: Path, name: str, words: list[str]) -> None:
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
    cpu, wall = used.ru_utime + used.ru_stime, time.perf_counter() - start
    print(f"{name:10} {jobs:>7} {cpu:7.1f} {wall:7.1f} {used.ru_maxrss / 1024:6.0f}", flush=True)


if __name__ == "__main__":
    main()
