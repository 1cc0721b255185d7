"""Memory and time of every kind of job of a run, for the requests made of a cluster.

    python benchmarks/job_costs.py [CONFIG] [TARGET ...]

Runs the workflow from nothing in a temporary folder (config/config.yaml, all tables), and asks the
kernel at the end of each process of a job for the most memory that it had and for its processor
time. Prints for each rule and codec the number of jobs, the most MiB and the most seconds.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]
NOTING = """
import atexit


@atexit.register
def note():
    import json, os, resource, sys

    usage = resource.getrusage(resource.RUSAGE_SELF)
    cost = [sys.argv, usage.ru_maxrss / 1024, usage.ru_utime + usage.ru_stime]
    with open(os.path.join({folder!r}, str(os.getpid())), "w") as file:
        json.dump(cost, file)
"""


def main() -> None:
    config = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "config" / "config.yaml").resolve()
    with tempfile.TemporaryDirectory() as name:
        costs = run(Path(name), config, sys.argv[2:] or ["tables"])
    print(f"{'job':32} {'jobs':>5} {'most MiB':>9} {'most s':>7}")
    for kind, jobs in sorted(costs.items()):
        mib, seconds = (max(job[at] for job in jobs) for at in (0, 1))
        print(f"{kind:32} {len(jobs):5} {mib:9.0f} {seconds:7.1f}")


def run(folder: Path, config: Path, targets: list[str]) -> dict[str, list[tuple[float, float]]]:
    """Kind of job to MiB and seconds of each; every Python of the run notes what it took."""
    noting, notes = folder / "noting", folder / "notes"
    noting.mkdir()
    notes.mkdir()
    (noting / "sitecustomize.py").write_text(NOTING.format(folder=str(notes)))
    paths = os.pathsep.join(filter(None, [str(noting), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", "snakemake", "--snakefile", ROOT / "workflow" / "Snakefile"]
    options = ["--configfile", config, "--cores", "2", "--quiet", "rules", "host", "reason"]
    environment = {**os.environ, "PYTHONPATH": paths}
    subprocess.run([*command, *targets, *options], cwd=folder, env=environment, check=True)
    costs = defaultdict(list)
    for note in notes.iterdir():
        words, mib, seconds = json.loads(note.read_text())
        costs[kind_of(words)].append((mib, seconds))
    return costs


def kind_of(words: list[str]) -> str:
    """The command and codec of a process, or the name of its script."""
    program = Path(words[0])
    if program.parent.name != "puckbench":
        return program.parent.name if program.name == "__main__.py" else program.name
    codec = words[words.index("--codec") + 1] if "--codec" in words else ""
    name = words[2] if words[1] in {"table", "figure"} else codec
    return f"{words[1]} {name}".rstrip()


if __name__ == "__main__":
    main()
