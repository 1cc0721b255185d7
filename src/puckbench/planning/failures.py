from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from puckbench.core.files import text_end, write_bytes
from puckbench.core.yaml_files import yaml_text
from puckbench.jobs.cost import BEGIN as COST

PREFIX = "puckbench: "
"""Beginning of the last line in the log of a failed job."""
_MAX_LINES = 10
_CURVES = ("coded", "metrics", "decoded", "recovery", "coded_drives", "drive_tasks")
"""Log folders of jobs for one data set, cloud and codec."""
_TAIL_BYTES = 1 << 16
_FATAL = re.compile(r"^Fatal Python error: (.+)$", re.MULTILINE)
_TIMEOUT = re.compile(r"^Timeout \((\d+:\d\d:\d\d(?:\.\d+)?)\)!$", re.MULTILINE)


class Failure(NamedTuple):
    """A failed job, with its data set, cloud and codec, which may be empty strings."""

    dataset: str
    cloud: str
    codec: str
    what: str
    reason: str
    log: Path

    def __str__(self) -> str:
        return f"{self.what}: {self.reason}; log: {self.log}"


def failed_jobs(logs: Path, since: float) -> list[Failure]:
    """Return the failed jobs whose logs were written since a time stamp (s)."""
    new = [log for log in sorted(logs.rglob("*.log")) if log.stat().st_mtime >= since]
    return [failure for log in new if (failure := failure_of(log, logs))]


def failure_of(log: Path, logs: Path) -> Failure | None:
    reason = _reason(log)
    if reason is None:
        return None
    kind, *names = log.relative_to(logs).with_suffix("").parts
    dataset, cloud, codec = ("", "", "")
    if kind in _CURVES and len(names) >= 3:
        dataset, cloud, codec, *part = names
        what = ", ".join([f"codec {codec}", f"cloud {dataset}/{cloud}", *part])
        reason = _without_names(reason, "/".join([dataset, cloud, codec]), codec)
    else:
        if kind == "clouds" and len(names) == 2:
            dataset, cloud = names
        what = "/".join([kind, *names])
    return Failure(dataset, cloud, codec, what, reason, log)


def write_failures(
    path: Path, failures: list[Failure], before: Mapping[str, str] | None = None
) -> Path | None:
    """Write a configuration file that excludes the clouds and curves whose jobs failed.

    The file also excludes `before`, the clouds and curves that this run excluded. If there is no
    failure, or a failure belongs to no cloud, write no file and return None.
    """
    if not failures or not all(failure.cloud for failure in failures):
        if not before:
            path.unlink(missing_ok=True)
        return None
    reasons = {
        "/".join(filter(None, [f.dataset, f.cloud, f.codec])): f"{f.reason}; log: {f.log}"
        for f in failures
    }
    write_bytes(path, yaml_text({"failed": {**(before or {}), **reasons}}).encode())
    return path


def failure_lines(failures: list[Failure]) -> Iterator[str]:
    """Yield a line with one log for each codec and reason, up to a maximum number."""
    groups: dict[tuple[str, str], list[Failure]] = {}
    for failure in failures:
        key = failure.codec or failure.what, failure.reason
        groups.setdefault(key, []).append(failure)
    for first, *others in list(groups.values())[:_MAX_LINES]:
        more = f" (and {len(others)} more)" if others else ""
        yield f"{PREFIX}{first}{more}"
    if len(groups) > _MAX_LINES:
        yield f"{PREFIX}{len(groups) - _MAX_LINES} more errors, in the logs"


def _without_names(reason: str, curve: str, codec: str) -> str:
    reason = re.sub(rf"\S*coded/{re.escape(curve)}\.zip: ", "", reason, count=1)
    return reason.replace(f"codec {codec}: ", "", 1)


def _reason(log: Path) -> str | None:
    text = text_end(log, _TAIL_BYTES)
    last = text.rpartition("\n")[2]
    if last.startswith(COST):
        return None
    if last.startswith(PREFIX):
        return last.removeprefix(PREFIX)
    if fatal := _FATAL.search(text):
        return f"the process died: {fatal[1]}"
    if timeout := _TIMEOUT.search(text):
        return f"took longer than its limit of {timeout[1]} (timing.timeout_s)"
    return "the process was killed, or ended without a message (out of memory?)"
