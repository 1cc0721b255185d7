"""Provenance of results: which settings and which code made the files of each job.

Snakemake stores this in the working folder only. A job's log also ends with a digest of its
settings and code. Logs lie in the results folder, so they stay with results that are copied or
moved.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from pointkit.errors import InputError
from puckbench.steps.cost import read_cost

_LOGS = "logs"


class Provenance:
    """Tells with which settings and code the present results of a run were made.

    Parameters
    ----------
    results
        The results folder, with the logs of the jobs.
    """

    def __init__(self, results: Path) -> None:
        logs = results / _LOGS
        self._keys = {_name(log, logs): _key(log) for log in logs.rglob("*.log")}
        made = (path for path in results.glob("*/**/*") if path.is_file())
        self._made = {_name(path, results) for path in made if not path.is_relative_to(logs)}
        self._made |= {_name(path, results) for path in results.glob("*.*")}

    def is_made_otherwise(self, job: str, key: str) -> bool:
        """Return whether the results of a job are there, but not known to be made as planned now.

        Parameters
        ----------
        job
            Name of the job, i.e. the path of its log in the folder of logs, without the suffix.
        key
            Digest of the settings and code with which the job would run now.
        """
        return self._keys.get(job) != key and (job in self._keys or job in self._made)

    @property
    def is_lost(self) -> bool:
        """Whether the folder has results, but no log that tells how they were made."""
        jobs = (job for job in self._made if job.partition("/")[0] in _OF_JOBS)
        return not any(self._keys.values()) and any(jobs)


_OF_JOBS = {"scenes", "clouds", "coded", "metrics", "drives", "residuals", "tables", "figures"}
"""Folders in the results folder in which only jobs write."""


def _name(path: Path, folder: Path) -> str:
    return path.relative_to(folder).with_suffix("").as_posix()


def _key(log: Path) -> str:
    """Return the job's key in a log, or an empty text if the log has none."""
    with suppress(InputError, OSError):
        if cost := read_cost(log):
            return str(cost.get("key", ""))
    return ""
