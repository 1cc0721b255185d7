"""Seconds and memory of planning the thesis at full size, and of Snakemake alone for as many jobs.

    python -m benchmarks.performance.planning [CLOUDS_OF_THE_BARE_WORKFLOW]

Four dry runs, each a process of its own: config/thesis.yaml with stand-ins (996 clouds, five codecs
at six to eight rates), planned and no more (--quiet); a bare workflow of as many clouds and cells
with the shortest rules there can be; one tenth of the first by Snakemake's own --batch; and the
first once more with every job and its reasons put together, printed or not, and counted. Prints
jobs, processor and wall seconds, peak memory.
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
BARE = """
RATES = [8, 8, 8, 6, 7]
CELLS = [(i, k, r) for i in range({clouds}) for k in range(5) for r in range(RATES[k])]

rule table:
    input: [f"metrics/{{c}}/{{k}}/{{r}}.json" for c, k, r in CELLS]
    output: "table.csv"
    shell: "touch {{output}}"

rule evaluate:
    input: "coded/{{cloud}}/{{codec}}/{{rate}}.bin"
    output: "metrics/{{cloud}}/{{codec}}/{{rate}}.json"
    shell: "touch {{output}}"

rule encode:
    input: "clouds/{{cloud}}.ply"
    output: "coded/{{cloud}}/{{codec}}/{{rate}}.bin"
    shell: "touch {{output}}"

rule cloud:
    output: "clouds/{{cloud}}.ply"
    shell: "touch {{output}}"
"""


def main() -> None:
    clouds = int(sys.argv[1]) if len(sys.argv) > 1 else 996
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "bare.smk").write_text(BARE.format(clouds=clouds))
        thesis = [
            *("--snakefile", str(ROOT / "workflow" / "Snakefile")),
            *("--configfile", str(ROOT / "config" / "thesis.yaml"), "--config", "stand_in=true"),
        ]
        print(f"{'':10} {'jobs':>7} {'cpu s':>7} {'wall s':>7} {'MiB':>6}")
        dry_run(folder, "thesis", thesis)
        dry_run(folder, "bare", ["--snakefile", "bare.smk"])
        dry_run(folder, "a tenth", ["--batch", "metrics_table=1/10", *thesis])
        dry_run(folder, "every job", [*EACH, *thesis])


def dry_run(folder: Path, name: str, words: list[str]) -> None:
    """Plan in a process of its own and print what it cost."""
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
