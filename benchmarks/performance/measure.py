"""Measure subjects, one after the other, into the file that the pages quote (`make measure`).

    python -m benchmarks.performance.measure [SUBJECT ...] [--tmc3 PROGRAM] [--pc-error PROGRAM]
        [--recordings FILE ...] [--results docs/notes/performance.json] [--trial]

Without names, all subjects, which takes at most an hour of an idle machine; each has a process of
its own. A subject whose program is missing is left out with a line that says so, and keeps the rows
of its last measurement. The file is written after each subject. `make measure` then writes the
pages.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from benchmarks.performance.rows import Inputs, MissingProgramError, Row

from pointkit.files import read_json, write_bytes
from pointkit.threads import allowed_threads
from puckbench.core.environment import cpu_model, libraries, source_commit

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "notes" / "performance.json"
MEASURED = ("src", "benchmarks", "workflow", "config")
SUBJECTS = {
    "run": ("The default run", "performance.default_run:measure"),
    "planning": ("Planning the thesis at full size", "performance.planning:measure"),
    "start": ("Start of commands", "performance.start:measure"),
    "scans": ("Virtual scans", "performance.scan_speed:measure"),
    "puck": ("Turns and recordings", "performance.puck:measure"),
    "ouster": ("Recordings of Ouster sensors beside OSF", "performance.ouster:measure"),
    "clouds": ("Messages of clouds", "performance.clouds:measure"),
    "gpcc": ("G-PCC", "performance.gpcc:measure"),
    "attributes": ("G-PCC with reflectances", "performance.gpcc:measure_attributes"),
    "codecs": ("Codecs of rooms and objects", "performance.codecs:measure"),
    "scale": ("Large input", "performance.scale:measure"),
    "metrics": ("Metrics", "checks.metrics_vs_pc_error:measure"),
}
"""Title of each subject and the function that yields its rows, by name."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("subjects", nargs="*", metavar="SUBJECT", help=", ".join(SUBJECTS))
    parser.add_argument("--tmc3", default="", help="MPEG's reference software of G-PCC")
    parser.add_argument("--pc-error", default="", help="MPEG's program of metrics")
    parser.add_argument("--recordings", nargs="*", type=Path, default=[])
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--trial", action="store_true", help="the least, to see that it runs")
    options = parser.parse_args()
    if unknown := [name for name in options.subjects if name not in SUBJECTS]:
        parser.error(f"no subject {unknown[0]}; there are {', '.join(SUBJECTS)}")
    programs = {"TMC3": options.tmc3, "PC_ERROR": options.pc_error}
    inputs = Inputs(programs, options.recordings or fetched_recordings(), options.trial)
    head = {
        "commit": commit(),
        "processor": cpu_model(),
        "cores": allowed_threads(),
        "versions": libraries(),
    }
    results = read_json(options.results) if options.results.exists() else {}
    has_failed = False
    for number, name in enumerate(names := options.subjects or list(SUBJECTS), 1):
        print(f"{name} ({number} of {len(names)})", flush=True)
        with ProcessPoolExecutor(1, get_context("spawn")) as process:
            subject = process.submit(measured, name, inputs)
        if error := subject.exception():
            is_missing = isinstance(error, MissingProgramError)
            has_failed |= not is_missing
            print(f"  {'left out' if is_missing else 'failed'}: {error}", flush=True)
        else:
            results[name] = head | subject.result()
            write_bytes(options.results, file_text(results).encode())
    sys.exit(has_failed)


def fetched_recordings() -> list[Path]:
    """Return the captures and bags that `puckbench data` has fetched into data/."""
    found = (ROOT / "data").glob("*recordings/*")
    return sorted(path for path in found if path.suffix in {".bag", ".db3", ".mcap", ".pcap"})


def commit() -> str:
    """Return the commit of the sources, with ``-dirty`` if what is measured was changed since."""
    hexadecimal = source_commit().removesuffix("-dirty")
    command = ["git", "diff", "--quiet", "HEAD", "--", *MEASURED]
    is_changed = subprocess.run(command, cwd=ROOT, check=False).returncode == 1
    return hexadecimal + "-dirty" * is_changed


def measured(name: str, inputs: Inputs) -> dict[str, Any]:
    """Measure one subject, and print each row as soon as it is known."""
    title, function = SUBJECTS[name]
    start, rows = time.monotonic(), []
    for row in resolve_name(f"benchmarks.{function}")(inputs):
        print(f"  {row}", flush=True)
        rows.append(dict(fields_of(row)))
    return {
        "title": title,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "minutes": round((time.monotonic() - start) / 60, 1),
        "rows": rows,
    }


def fields_of(row: Row) -> Iterator[tuple[str, Any]]:
    """Yield name and value of what a row has: numbers with four digits, with ratio and verdict."""
    derived = {"ratio": row.ratio, "is_met": row.is_met}
    for name, value in (vars(row) | derived).items():
        if value not in ("", None):
            is_real = isinstance(value, float) and value != int(value)
            yield name, float(f"{value:.4g}") if is_real else value


def file_text(results: dict[str, dict[str, Any]]) -> str:
    """Return JSON with a line for each row, so that a change of one is a change of one line."""
    subjects = []
    for name in (name for name in SUBJECTS if name in results):
        entry = results[name]
        lines = [f"  {json.dumps(key)}: {json.dumps(entry[key])}" for key in entry if key != "rows"]
        rows = ",\n".join(f"   {json.dumps(row)}" for row in entry["rows"])
        lines.append(f'  "rows": [\n{rows}\n  ]')
        subjects.append(f" {json.dumps(name)}: {{\n" + ",\n".join(lines) + "\n }")
    return "{\n" + ",\n".join(subjects) + "\n}\n"


if __name__ == "__main__":
    main()
