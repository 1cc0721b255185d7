from __future__ import annotations

import argparse
import csv
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.cli.registry import COMMANDS
from puckbench.cli.types import integer
from puckbench.core.errors import InputError

if TYPE_CHECKING:
    from puckbench.thesis.checklist import Reproduction


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


@COMMANDS.register(
    "reproduce",
    arguments=arguments,
    help="list the thesis's figures and tables, and how to make those that are missing",
)
def run(options: argparse.Namespace) -> dict[str, Any]:
    from puckbench.thesis.checklist import Reproduction

    changes = {"stand_in": True} if options.stand_in else {}
    reproduction = Reproduction(options.config, options.snakefile, changes, options.cores)
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
