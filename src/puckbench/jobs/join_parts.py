from __future__ import annotations

from pathlib import Path
from typing import Any

from puckbench.jobs.curve_files import read_curve, read_rows, write_curve, write_rows
from puckbench.jobs.registry import JOBS, Job


@JOBS.register("join_streams")
class JoinStreams(Job):
    """Join the archives of jobs that each encoded some rates of a curve."""

    def run(self, parts: tuple[Path, ...], curve: Path) -> dict[str, Any]:
        coded = {rate: item for part in parts for rate, item in read_curve(part).items()}
        write_curve(curve, coded)
        return {"streams": len(coded)}


@JOBS.register("join_rows")
class JoinRows(Job):
    """Join the result rows of jobs that each measured some rates of a curve."""

    def run(self, parts: tuple[Path, ...], rows: Path) -> dict[str, Any]:
        results = read_rows(parts)
        write_rows(rows, results)
        return {"rows": len(results)}
