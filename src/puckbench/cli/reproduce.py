"""`puckbench reproduce`: the thesis's figures and tables, what is made, how to make the rest."""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

from puckbench.cli.types import whole
from puckbench.core.errors import InputError
from puckbench.planning.checklist import Reproduction
from puckbench.planning.job_times import Estimate, estimated, read_job_times

_ABOUT_THE_SAME = 1.1
"""Planned over measured points up to which nothing is said of extrapolation."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--config", type=Path, default=Path("config/thesis.yaml"))
    parser.add_argument("--stand-in", action="store_true", help="with the generated data")
    parser.add_argument("--cores", type=whole(1), default=2, help="of the commands printed")
    parser.add_argument("--snakefile", type=Path, default=Path("workflow/Snakefile"))
    parser.add_argument(
        "--exact", action="store_true", help="ask Snakemake, which sees changed code (minutes)"
    )
    parser.add_argument(
        "--estimate",
        type=Path,
        metavar="RUN",
        help="core-hours of the whole configuration, from the jobs of the run made in this folder",
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """The checklist; or with --estimate what a whole run would take."""
    changes = {"stand_in": True} if options.stand_in else {}
    asked = Reproduction(options.config, options.snakefile, changes, options.cores)
    if options.estimate:
        found = estimated(asked.job_kinds(), read_job_times(options.estimate))
        return _estimate(found)
    pending = _pending(asked) if options.exact and not asked.absent else None
    items = asked.items(None if pending is None else [file for file, _ in pending])
    left = None if pending is None else _jobs_by_rule(pending, asked.results)
    if options.json:
        rows = [vars(item) for item in items]
        done = {} if asked.absent else asked.progress()
        return {"items": rows, "absent": asked.absent, "made": done, "left": left}
    answer = {item.title: item.line() for item in items}
    if asked.absent:
        faults = {f"data of {name}": fault for name, fault in asked.absent.items()}
        return answer | faults | {"without them": "puckbench reproduce --stand-in"}
    made = {name: f"{there} of {of}" for name, (there, of) in asked.progress().items()}
    return answer | made | {f"left: {rule}": count for rule, count in (left or {}).items()}


def _pending(asked: Reproduction) -> list[tuple[str, str]]:
    """File and rule of all that Snakemake would make; InputError when Snakemake fails."""
    words = [sys.executable, "-m", *asked.command("--summary")]
    words += ["--snakefile", str(asked.snakefile)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise InputError(f"snakemake --summary failed: {last}")
    rows = csv.DictReader(done.stdout.splitlines(), delimiter="\t")
    return [(row["output_file"], row["rule"]) for row in rows if row["plan"] != "no update"]


def _jobs_by_rule(pending: list[tuple[str, str]], results: Path) -> dict[str, int]:
    """Jobs by rule; the files of one job have one name below their folders."""
    names = {
        (rule, Path(file).relative_to(results).with_suffix("").parts[1:]) for file, rule in pending
    }
    return dict(Counter(rule for rule, _ in names))


def _estimate(found: list[Estimate]) -> dict[str, Any]:
    """Core-hours by rule and codec, and what they rest on."""
    groups: dict[str, list[Estimate]] = defaultdict(list)
    for one in found:
        groups[_group(one)].append(one)
    answer: dict[str, Any] = {name: _line(group) for name, group in groups.items()}
    known = [one for one in found if one.seconds is not None]
    answer["total"] = f"{sum(one.hours for one in known):.1f} core-hours"
    jobs, of = (sum(one.kind.jobs for one in some) for some in (known, found))
    answer["covers"] = f"{jobs} of {of} jobs; the others were not measured and are not in the total"
    return answer


def _group(one: Estimate) -> str:
    kind = one.kind
    return f"{kind.job} {kind.codec}".rstrip()


def _line(group: list[Estimate]) -> str:
    jobs = sum(one.kind.jobs for one in group)
    known = [one for one in group if one.seconds is not None]
    if not known:
        return f"{jobs} jobs, not measured"
    hours, covered = sum(one.hours for one in known), sum(one.kind.jobs for one in known)
    measured = _measured(known)
    notes = [f"from {measured} job{'s' if measured > 1 else ''}"]
    reach = max(one.reach for one in known)
    if reach > _ABOUT_THE_SAME:
        notes.append(f"extrapolated to {reach:.1f} times their points")
    if covered < jobs:
        notes.append(f"{jobs - covered} jobs not measured")
    if not all(one.exact for one in known):
        notes.append("some from curves of other numbers of rates")
    each = 3600 * hours / covered
    return f"{hours:.2f} core-hours: {jobs} jobs of {each:.1f} s ({'; '.join(notes)})"


def _measured(known: list[Estimate]) -> int:
    """Jobs that estimates of a codec rest on."""
    return sum({(one.kind.truth, one.kind.rates): one.measured for one in known}.values())
