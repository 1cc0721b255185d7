"""Time of a run of Snakemake from nothing, in a clean copy of the working tree.

    python -m benchmarks.performance.default_run [TARGET ...] [--cores 2]

Nothing is compiled in the copy, and installing is not counted. Prints the wall clock until the
first figure and until the end, and seconds of the processor: of all jobs, from their logs, and of
Snakemake's own process, without its children.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.performance.rows import Inputs, Row

from puckbench.steps.cost import read_costs

ROOT = Path(__file__).parents[2]
CORES = 2
AIM_S, FIRST_AIM_S = 480, 60
SMALL = "results/clouds/objects/chair_02.ply"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", help="default: all")
    parser.add_argument("--cores", type=int, default=CORES)
    options = parser.parse_args()
    for row in run(options.targets, options.cores):
        print(row, flush=True)


def measure(inputs: Inputs) -> Iterator[Row]:
    return run([SMALL] if inputs.is_trial else [], CORES)


def run(targets: list[str], cores: int) -> Iterator[Row]:
    words = ["--cores", str(cores), *targets]
    with TemporaryDirectory() as name:
        folder = Path(name)
        copy_tree(folder)
        environment = {**os.environ, "PYTHONPATH": str(folder / "src")}
        for variable in ("PYTHONDONTWRITEBYTECODE", "NUMBA_CACHE_DIR"):
            environment.pop(variable, None)
        clock, start = time.perf_counter(), time.time()
        command = [sys.executable, "-m", "snakemake", *words, "--logger", "puckbench"]
        snakemake = subprocess.Popen(command, cwd=folder, env=environment)
        own_s = 0.0
        while snakemake.poll() is None:
            own_s = max(own_s, own_seconds(snakemake.pid))
            time.sleep(0.2)
        wall_s = time.perf_counter() - clock
        if snakemake.returncode:
            raise SystemExit(f"Snakemake ended with status {snakemake.returncode}")
        costs = list(read_costs(folder))
        figures = [file.stat().st_mtime for file in folder.glob("results/first_look/*.png")]
    what = f"snakemake {' '.join(words)}, {len(costs)} jobs"
    yield Row(f"{what}: to the end", wall_s, "s", at_most=None if targets else AIM_S)
    if figures:
        first_s = min(figures) - start
        yield Row(f"{what}: to the first figure", first_s, "s", at_most=FIRST_AIM_S)
    yield Row(f"{what}: all jobs", sum(cost["processor_s"] for cost in costs), "processor s")
    yield Row(f"{what}: Snakemake's process", own_s, "processor s")


def copy_tree(folder: Path) -> None:
    """Copy the files that Git knows or would add."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        if (source := ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, folder / name)


def own_seconds(process: int) -> float:
    """Processor time of a process without its children; 0 after its end."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
