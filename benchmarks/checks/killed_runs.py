"""Runs killed at random points and resumed: are their results those of an undisturbed run?

    python -m benchmarks.checks.killed_runs [--kills 20] [--seed 1] [--only-snakemake] [--cores 2]
        [--target tables] [--like FOLDER --longest SECONDS] [CONFIG]

CONFIG (benchmarks/small.yaml) runs once undisturbed, or that run is in FOLDER. In another folder
runs are killed (SIGKILL to the process group, or to Snakemake alone) after random seconds, at most
half of the undisturbed time, and resumed. After each kill the files must be those of that run; at
each end all of them must be there, except for times. Exit status 1 if they are not.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from tests.support.same_results import after_a_kill, differences

from pointkit.seeding import generator

ROOT = Path(__file__).parents[2]
SNAKEFILE = ROOT / "workflow" / "Snakefile"
SMALL = ROOT / "benchmarks" / "small.yaml"
LONGEST_SHARE = 0.5
"""Of the undisturbed run's time, at most, before a kill: some kills fall into each run."""


@dataclass
class Folder:
    path: Path
    config: Path
    target: str
    cores: int

    @property
    def results(self) -> Path:
        return self.path / "results"

    def start(self) -> subprocess.Popen[bytes]:
        self.path.mkdir(exist_ok=True)
        program = [
            sys.executable,
            "-m",
            "snakemake",
            "--snakefile",
            str(ROOT / "workflow" / "Snakefile"),
        ]
        words = ["--configfile", str(self.config), "--config", "results=results"]
        words += ["--cores", str(self.cores)]
        with (self.path / "run.log").open("ab") as log:
            return subprocess.Popen(
                [*program, self.target, "--quiet", "rules", "host", "reason", *words],
                cwd=self.path,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def half_written(self) -> int:
        return sum(".tmp" in path.name for path in self.results.rglob(".*"))


def undisturbed(folder: Folder) -> float:
    start = time.perf_counter()
    if folder.start().wait():
        raise SystemExit((folder.path / "run.log").read_text()[-2000:])
    return time.perf_counter() - start


def killed(folder: Folder, seconds: float | None, group: bool) -> bool:
    """Start a run and kill it after some seconds; False when it came to its end before."""
    run = folder.start()
    try:
        status = run.wait(seconds)
    except subprocess.TimeoutExpired:
        return True
    finally:
        if run.poll() is None:
            (os.killpg if group else os.kill)(run.pid, signal.SIGKILL)
            run.wait()
    if status:
        raise SystemExit((folder.path / "run.log").read_text()[-2000:])
    return False


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("config", type=Path, nargs="?", default=SMALL)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only-snakemake", action="store_true")
    parser.add_argument("--cores", type=int, default=2, help="of the runs that are killed")
    parser.add_argument("--target", default="tables")
    parser.add_argument("--like", type=Path, help="folder of a whole run of CONFIG")
    parser.add_argument("--longest", type=float, help="seconds before a kill")
    options = parser.parse_args()
    if options.like and not options.longest:
        parser.error("--like needs --longest")
    with tempfile.TemporaryDirectory() as name:
        sys.exit(campaign(Path(name), options))


def campaign(place: Path, options: argparse.Namespace) -> int:
    config, longest = options.config.resolve(), options.longest
    reference = Folder(options.like or place / "undisturbed", config, options.target, cores=2)
    if options.like is None:
        whole = undisturbed(reference)
        print(f"undisturbed: {whole:.0f} s", flush=True)
        longest = longest or LONGEST_SHARE * whole
    random = generator(options.seed, "killed runs")
    folder = Folder(place / "killed", config, options.target, options.cores)
    kills = ends = findings = 0
    while kills < options.kills or folder.path.exists():
        last = kills == options.kills
        wait = None if last else random.uniform(0, longest)
        if killed(folder, wait, not options.only_snakemake):
            kills += 1
            findings += report(f"kill {kills} after {wait:.1f} s", folder, reference, False)
            continue
        ends += 1
        findings += report(f"end {ends}", folder, reference, True)
        shutil.rmtree(folder.path)
    print(f"{kills} kills, {ends} runs to their end, {findings} files not as they should be")
    return int(findings > 0)


def report(what: str, folder: Folder, reference: Folder, finished: bool) -> int:
    """Print what is there and what is not as it should be; how many files are not."""
    found = (differences if finished else after_a_kill)(folder.results, reference.results)
    files = sum(path.is_file() for path in folder.results.rglob("*"))
    print(f"{what}: {files} files, {folder.half_written()} half written", *found, sep="\n  ")
    sys.stdout.flush()
    return len(found)


if __name__ == "__main__":
    main()
