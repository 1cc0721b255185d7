"""Memory and time of every kind of job of a run, as a cluster's job requests need them.

    python -m benchmarks.performance.job_costs [CONFIG] [TARGET ...] [--cores 2] [--out FILE]

Runs the workflow from nothing in a temporary folder (config/config.yaml, all tables), and asks the
kernel at the end of each process of a job for the most memory that it had and for its processor
time. Prints for each rule and codec the number of jobs, the most MiB and the most seconds. FILE
gets the processor time of every job, for `puckbench reproduce --estimate FILE`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

from puckbench.planning.job_times import JobTime, job_time

ROOT = Path(__file__).parents[2]
NOTING = """
import atexit
import time

START = time.perf_counter()


@atexit.register
def note():
    import json, os, resource, sys

    usage = resource.getrusage(resource.RUSAGE_SELF)
    wall = time.perf_counter() - START
    cost = [sys.argv, usage.ru_maxrss / 1024, usage.ru_utime + usage.ru_stime, wall]
    with open(os.path.join({folder!r}, str(os.getpid())), "w") as file:
        json.dump(cost, file)
"""


class Cost(NamedTuple):
    """What a process took; words: of its command. seconds: of the processor; wall_s: in all."""

    words: list[str]
    mib: float
    seconds: float
    wall_s: float

    @property
    def is_command(self) -> bool:
        """Whether it is one of puckbench's; else a script of the workflow, or Snakemake itself."""
        return Path(self.words[0]).parent.name == "puckbench"

    @property
    def kind(self) -> str:
        """Its command and codec, or the name of its script."""
        program = Path(self.words[0])
        if not self.is_command:
            return program.parent.name if program.name == "__main__.py" else program.name
        codec = self.words[self.words.index("--codec") + 1] if "--codec" in self.words else ""
        name = self.words[2] if self.words[1] in {"table", "figure"} else codec
        return f"{self.words[1]} {name}".rstrip()

    def time(self, run: Path, results: str) -> JobTime | None:
        """Its processor time as the job of a run; None for scripts, which are few and short.

        Its timed call is given the same share of the processor as the whole.
        """
        made = [Path(word) for word in self.words if word.startswith(f"{results}/")]
        if not self.is_command or not made:
            return None
        command, named = self.words[1], self.words[2]
        rule = {"table": named, "figure": named, "wall": "wall_points"}.get(command, command)
        output = made[0] if command in {"scene", "table", "figure"} else made[1]
        if "--row" in self.words:
            output = Path(self.words[self.words.index("--row") + 1])
            rule = "scan_error" if "scan_errors" in output.parts else rule
        log = Path(results, "logs", *output.relative_to(results).parts).with_suffix(".log")
        found = job_time(run, rule, log, self.seconds)
        return replace(found, call_s=found.call_s * min(1.0, self.seconds / self.wall_s))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("config", nargs="?", type=Path, default=ROOT / "config" / "config.yaml")
    parser.add_argument("targets", nargs="*", default=["tables"])
    parser.add_argument("--cores", default="2")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        costs = run(Path(name), options.config.resolve(), options.targets, options.cores)
        if options.out:
            write(options.out, Path(name), costs)
    kinds = defaultdict(list)
    for cost in costs:
        kinds[cost.kind].append(cost)
    print(f"{'job':32} {'jobs':>5} {'most MiB':>9} {'most s':>7}")
    for kind, jobs in sorted(kinds.items()):
        mib, seconds = max(job.mib for job in jobs), max(job.seconds for job in jobs)
        print(f"{kind:32} {len(jobs):5} {mib:9.0f} {seconds:7.1f}")


def run(folder: Path, config: Path, targets: list[str], cores: str) -> list[Cost]:
    """Run the workflow there, into `results`; every Python of the run notes what it took."""
    noting, notes = folder / "noting", folder / "notes"
    noting.mkdir(exist_ok=True)
    notes.mkdir(exist_ok=True)
    (noting / "sitecustomize.py").write_text(NOTING.format(folder=str(notes)))
    paths = os.pathsep.join(filter(None, [str(noting), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", "snakemake", "--snakefile", ROOT / "workflow" / "Snakefile"]
    options = ["--configfile", config, "--config", "results=results", "--cores", cores]
    quiet = ["--quiet", "rules", "host", "reason"]
    environment = {**os.environ, "PYTHONPATH": paths}
    subprocess.run([*command, *targets, *options, *quiet], cwd=folder, env=environment, check=True)
    return [Cost(*json.loads(note.read_text())) for note in notes.iterdir()]


def write(file: Path, folder: Path, costs: list[Cost]) -> None:
    """Write every job's time."""
    times = [time for cost in costs if (time := cost.time(folder, "results"))]
    jobs = [asdict(time) for time in sorted(times, key=lambda time: (time.rule, time.codec))]
    file.write_text(json.dumps({"jobs": jobs}, indent=1))


if __name__ == "__main__":
    main()
