"""Provenance of results: which settings and which code made the files of each job.

Snakemake stores this in the working folder only. A job's log also ends with a digest of its
settings and code. Logs lie in the results folder, so they stay with results that are copied or
moved.
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
"""File that is an input of every job, and is newer than all results at the start of a run.

Snakemake compares its time only for jobs whose present results were made with other settings or
code, and so makes these results again.
"""
_RESULTS = ("scenes", "clouds", "coded", "metrics", "drives", "residuals", "tables", "figures")


def time_of_planning(folder: Path) -> float:
    """Return the current time stamp, in s, by the clock of a folder's file system."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder) as probe:
            return os.fstat(probe.fileno()).st_mtime
    except OSError as error:
        raise unwritable(folder, error) from error


def write_otherwise(planned_at: float) -> None:
    """Write the file `OTHERWISE`, and set its time of modification.

    Parameters
    ----------
    planned_at
        Time stamp, in s, before the first result of this run was made.
    """
    # Other content each time, since Snakemake ignores newer times of files with equal content.
    write_bytes(OTHERWISE, repr(planned_at).encode())
    os.utime(OTHERWISE, (planned_at, planned_at))


class Provenance:
    """Tells with which settings and code the present results of a run were made.

    Parameters
    ----------
    results
        The results folder, with the logs of the jobs.
    """

    def __init__(self, results: Path) -> None:
        self._results = results
        self._keys = {str(log): _key(log) for log in (results / "logs").rglob("*.log")}

    def is_made_by(self, log: str, job: PlannedJob) -> bool:
        """Return whether the job with this log ended with the settings and code of `job`."""
        return self._keys.get(log) == job.key

    def is_lost(self) -> bool:
        """Return whether the folder has results, but no log that tells how they were made."""
        folders = (self._results / name for name in _RESULTS)
        return not any(self._keys.values()) and any(
            path.is_file() for folder in folders for path in folder.rglob("*")
        )


def _key(log: Path) -> str:
    """Return the job's key in a log, or an empty text if the log has none."""
    with suppress(InputError, OSError):
        if cost := read_cost(log):
            return str(cost.get("key", ""))
    return ""
