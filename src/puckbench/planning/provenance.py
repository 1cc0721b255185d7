"""Provenance of results: the log of each job names the settings and code that made its files.

Snakemake remembers them in the working folder only. The logs lie beside the results, also beside
results that were copied, moved or replaced.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

from pointkit.errors import InputError
from pointkit.files import unwritable, write_bytes
from puckbench.jobs.cost import read_cost
from puckbench.planning.planned_job import RECORDS, PlannedJob

OTHERWISE = RECORDS / "made_otherwise"
"""An input of each job, newer than all results: results that were made otherwise are older."""
_RESULTS = ("scenes", "clouds", "coded", "metrics", "drives", "residuals", "tables", "figures")


def time_of_planning(folder: Path) -> float:
    """Return the present time (s) by the clock of a folder's file system."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder) as probe:
            return os.fstat(probe.fileno()).st_mtime
    except OSError as error:
        raise unwritable(folder, error) from error


def write_otherwise(planned_at: float) -> None:
    """Write the file `OTHERWISE` with a time (s) at which no result of this run had been made."""
    # Other content each time, since Snakemake ignores newer times of files with equal content.
    write_bytes(OTHERWISE, repr(planned_at).encode())
    os.utime(OTHERWISE, (planned_at, planned_at))


class Provenance:
    """Keys of the jobs that made the results, by log; see `PlannedJob.key`."""

    def __init__(self, results: Path) -> None:
        self._results = results
        self._keys = {str(log): _key(log) for log in (results / "logs").rglob("*.log")}

    def is_made_by(self, log: str, job: PlannedJob) -> bool:
        return self._keys.get(log) == job.key

    def is_lost(self) -> bool:
        """Return whether there are results, but no log says how they were made."""
        folders = (self._results / name for name in _RESULTS)
        return not any(self._keys.values()) and any(
            path.is_file() for folder in folders for path in folder.rglob("*")
        )


def _key(log: Path) -> str:
    """Return the key in a log; empty if an earlier version ran the job, or the job failed."""
    with suppress(InputError, OSError):
        if cost := read_cost(log):
            return str(cost.get("key", ""))
    return ""
