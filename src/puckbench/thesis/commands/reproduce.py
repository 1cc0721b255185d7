from __future__ import annotations

import argparse
import csv
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.cli.registry import COMMANDS
from puckbench.cli.types import integer
from puckbench.core.errors import InputError

if TYPE_CHECKING:
    from puckbench.planning.job_times import TimeEstimate
    from puckbench.thesis.checklist import Reproduction

_EXTRAPOLATED = 1.1
"""Ratio of planned to measured points above which an estimate is called an extrapolation."""


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, default=Path("config/thesis.yaml"))
    parser.add_argument("--stand-in", action="store_true", help="use the generated data")
    parser.add_argument(
        "--cores", type=integer(1), default=2, help="cores in the printed commands (default: 2)"
    )
    parser.add_argument("--snakefile", type=Path, default=Path("workflow/Snakefile"))
    parser.add_argument(
        "--exact",
        action="store_true",
        help="ask Snakemake, which also sees changed code (takes minutes)",
    )
    parser.add_argument(
        "--estimate",
        type=Path,
        metavar="RUN",
        help="estimate the core-hours of the whole configuration from the jobs of the run in this "
        "folder",
    )


@COMMANDS.register(
    "reproduce",
    arguments=arguments,
    help="list the thesis's figures and tables, and how to make those that are missing",
)
def run(options: argparse.Namespace) -> dict[str, Any]:
    from puckbench.thesis.checklist import Reproduction

    changes = {"stand_in": True} if options.stand_in else {}
    reproduction = Reproduction(options.config, options.snakefile, changes, options.cores)
    if options.estimate:
        return _estimated(reproduction, options.estimate)
    pending = _pending(reproduction) if options.exact and not reproduction.absent else None
    left = None if pending is None else _jobs_by_rule(pending, reproduction.results)
    items = reproduction.items(None if pending is None else [file for file, _ in pending])
    progress = {} if reproduction.absent else reproduction.progress()
    if options.json:
        rows = [vars(item) for item in items]
        return {"items": rows, "absent": reproduction.absent, "made": progress, "left": left}
    answer = {item.title: item.line() for item in items}
    if reproduction.absent:
        faults = {f"data of {name}": fault for name, fault in reproduction.absent.items()}
        return answer | faults | {"without them": "puckbench reproduce --stand-in"}
    made = {name: f"{existing} of {planned}" for name, (existing, planned) in progress.items()}
    return answer | made | {f"left: {rule}": count for rule, count in (left or {}).items()}


def _pending(reproduction: Reproduction) -> list[tuple[str, str]]:
    words = [sys.executable, "-m", *reproduction.command("--summary")]
    words += ["--snakefile", str(reproduction.snakefile)]
    process = subprocess.run(words, capture_output=True, text=True, check=False)
    if process.returncode:
        last = (process.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise InputError(f"snakemake --summary failed: {last}")
    rows = csv.DictReader(process.stdout.splitlines(), delimiter="\t")
    return [(row["output_file"], row["rule"]) for row in rows if row["plan"] != "no update"]


def _jobs_by_rule(pending: list[tuple[str, str]], results: Path) -> dict[str, int]:
    # The files of one job differ only in their folder and suffix.
    names = {
        (rule, Path(file).relative_to(results).with_suffix("").parts[1:]) for file, rule in pending
    }
    return dict(Counter(rule for rule, _ in names))


def _estimated(reproduction: Reproduction, run_folder: Path) -> dict[str, Any]:
    from puckbench.planning.job_times import estimated, read_job_times
    from puckbench.planning.stages import job_kinds

    estimates = estimated(job_kinds(reproduction.bench), read_job_times(run_folder))
    groups: dict[str, list[TimeEstimate]] = defaultdict(list)
    for estimate in estimates:
        groups[f"{estimate.kind.job} {estimate.kind.codec}".rstrip()].append(estimate)
    answer: dict[str, Any] = {name: _line(group) for name, group in groups.items()}
    measured = _measured(estimates)
    answer["total"] = f"{_hours(measured):.1f} core-hours"
    answer["covers"] = (
        f"{_jobs(measured)} of {_jobs(estimates)} jobs; the others were not measured and are not "
        "in the total"
    )
    return answer


def _measured(estimates: list[TimeEstimate]) -> list[TimeEstimate]:
    return [estimate for estimate in estimates if estimate.seconds is not None]


def _hours(estimates: list[TimeEstimate]) -> float:
    return sum(estimate.hours for estimate in estimates)


def _jobs(estimates: list[TimeEstimate]) -> int:
    return sum(estimate.kind.jobs for estimate in estimates)


def _line(group: list[TimeEstimate]) -> str:
    jobs, measured = _jobs(group), _measured(group)
    if not measured:
        return f"{jobs} jobs, not measured"
    hours, measured_jobs = _hours(measured), _jobs(measured)
    sample = _sample(measured)
    notes = [f"from {sample} job{'s' if sample > 1 else ''}"]
    reach = max(estimate.reach for estimate in measured)
    if reach > _EXTRAPOLATED:
        notes.append(f"extrapolated to {reach:.1f} times their points")
    if measured_jobs < jobs:
        notes.append(f"{jobs - measured_jobs} jobs not measured")
    if not all(estimate.exact for estimate in measured):
        notes.append("some from curves with other numbers of rates")
    seconds = 3600 * hours / measured_jobs
    return f"{hours:.2f} core-hours: {jobs} jobs of {seconds:.1f} s ({'; '.join(notes)})"


def _sample(measured: list[TimeEstimate]) -> int:
    kinds = {(each.kind.truth, each.kind.rates): each.measured for each in measured}
    return sum(kinds.values())
