from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from pointkit.files import text_end, write_bytes
from pointkit.yaml_files import yaml_text
from puckbench.steps.child import EXIT_STATUS, KILLED
from puckbench.steps.cost import BEGIN as COST
from puckbench.tables.registry import UNDECODED

PREFIX = "puckbench: "
"""Start of the last line in the log of a failed job, before the reason."""
INTERRUPTED = "interrupted"
_MAX_LINES = 10
_NOUNS = {
    "scenes": "scene",
    "samples": "sample",
    "scans": "scan",
    "clouds": "cloud",
    "scan_errors": "errors of scan",
    "drives": "drive",
    "weights": "training",
    "segmentation": "training",
    "tables": "table",
    "figures": "figure",
}
_OF_CURVES = {
    **dict.fromkeys(("coded", "metrics", "decoded", "recovery"), "cloud"),
    **dict.fromkeys(("coded_drives", "drive_tasks"), "drive"),
}
"""Kinds of jobs for one data set, cloud and codec, with the word for the cloud in messages."""
_LAST = ("report", "reference")
"""Jobs that no run can leave out, even if they fail."""
_TAIL_BYTES = 1 << 16
_END = re.compile(rf"{EXIT_STATUS}\d+$|{KILLED}\d+ \(\w+\)$")
_FATAL = re.compile(r"^Fatal Python error: (.+)$", re.MULTILINE)
_TIMEOUT = re.compile(r"^Timeout \((\d+:\d\d:\d\d(?:\.\d+)?)\)!$", re.MULTILINE)


class Failure(NamedTuple):
    """A job that failed, and why.

    Parameters
    ----------
    job
        Name of the job, which is the path of its log in the folder of logs, without the suffix;
        such as ``coded/DATASET/CLOUD/CODEC``.
    reason
        The reason in one line, from the end of the log.
    log
        Path of the log.
    """

    job: str
    reason: str
    log: Path

    @property
    def codec(self) -> str:
        """Name of the codec that the job ran; empty if it ran none."""
        kind, *names = self.job.split("/")
        return names[2] if kind in _OF_CURVES and len(names) > 2 else ""

    def __str__(self) -> str:
        return f"{described(self.job)}: {self.reason}; log: {self.log}"


def described(job: str) -> str:
    """Return what a job was for, in words such as ``codec draco, cloud rooms/office_1``.

    `job` is its name, such as ``coded/rooms/office_1/draco``.
    """
    kind, *names = job.split("/")
    if kind in _OF_CURVES and len(names) > 2:
        dataset, cloud, codec, *part = names
        if codec == UNDECODED:
            return f"{_OF_CURVES[kind]} {dataset}/{cloud}, {codec}"
        return ", ".join([f"codec {codec}", f"{_OF_CURVES[kind]} {dataset}/{cloud}", *part])
    return f"{_NOUNS[kind]} {'/'.join(names)}" if kind in _NOUNS else job


def failed_jobs(logs: Path, since: float) -> list[Failure]:
    """Return the failed jobs of a run.

    Parameters
    ----------
    logs
        Folder of the jobs' logs.
    since
        Time stamp of the run's start, in s. Logs that were last changed before it are ignored.
    """
    new = [log for log in sorted(logs.rglob("*.log")) if log.stat().st_mtime >= since]
    return [failure for log in new if (failure := failure_of(log, logs))]


def failure_of(log: Path, logs: Path) -> Failure | None:
    """Return the failure of the job with a log in the folder `logs`, or None if it succeeded."""
    reason = _reason(log)
    if reason is None:
        return None
    failure = Failure(log.relative_to(logs).with_suffix("").as_posix(), reason, log)
    if not failure.codec:
        return failure
    curve = failure.job.partition("/")[2]
    return failure._replace(reason=_without_names(reason, curve, failure.codec))


def write_failures(path: Path, failures: list[Failure], before: Mapping[str, str]) -> Path | None:
    """Write a configuration file with which the next run leaves out the failed jobs.

    Parameters
    ----------
    path
        File to write (YAML).
    failures
        The failed jobs of this run.
    before
        Jobs that this run left out already, with the reasons. They stay excluded.

    Returns
    -------
    Path | None
        The path of the file. If no further job failed that a run can leave out, no file is written,
        and None is returned.
    """
    reasons = {
        failure.job: f"{failure.reason}; log: {failure.log}"
        for failure in failures
        if failure.job not in _LAST and failure.reason != INTERRUPTED
    }
    if reasons.keys() <= before.keys():
        return None
    write_bytes(path, yaml_text({"failed": {**before, **reasons}}).encode())
    return path


def failure_key(failure: Failure) -> tuple[str, str]:
    """Return the key by which failures are grouped, so that each group is printed once.

    The key is the codec, or the job if it has no codec, and the reason.
    """
    return failure.codec or failure.job, failure.reason


def failure_lines(failures: list[Failure]) -> Iterator[str]:
    """Yield lines to print about failures, one for each group of `failure_key`.

    A line names one of the group's jobs with its log, and counts the others. There are at most ten
    such lines.
    """
    groups: dict[tuple[str, str], list[Failure]] = {}
    for failure in failures:
        groups.setdefault(failure_key(failure), []).append(failure)
    for first, *others in list(groups.values())[:_MAX_LINES]:
        more = f" (and {len(others)} more)" if others else ""
        yield f"{PREFIX}{first}{more}"
    if len(groups) > _MAX_LINES:
        yield f"{PREFIX}{len(groups) - _MAX_LINES} more errors, in the logs"


def _without_names(reason: str, curve: str, codec: str) -> str:
    archive = rf"(^|: )[^:]*coded(?:_drives)?/{re.escape(curve)}\.zip: "
    reason = re.sub(archive, r"\1", reason, count=1)
    return reason.replace(f"codec {codec}: ", "", 1)


def _reason(log: Path) -> str | None:
    text = text_end(log, _TAIL_BYTES)
    last = text.rpartition("\n")[2]
    if COST in last:  # after what a plug-in printed without a line break
        return None
    if PREFIX in last:
        return last.partition(PREFIX)[2]
    return _unexpected_end(text, last)


def _unexpected_end(text: str, last: str) -> str:
    """Return how a process ended that printed no reason, from the log's text and its last line."""
    end = found[0] if (found := _END.search(last)) else ""
    if fatal := _FATAL.search(text):
        return "; ".join(filter(None, [f"the process died: {fatal[1]}", end]))
    if timeout := _TIMEOUT.search(text):
        return f"took longer than its limit of {timeout[1]} (timing.timeout_s)"
    if end.startswith(EXIT_STATUS):
        return f"the process ended itself with {end}"
    if end:
        return f"the process was {end.replace('SIGKILL', 'SIGKILL; out of memory?')}"
    return "the process was killed, or ended itself without a message (out of memory?)"
