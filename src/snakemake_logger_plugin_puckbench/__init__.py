"""Logger plug-in of Snakemake: how long a run will take, then one bar with what is left.

``puckbench run`` shows it (``--logger puckbench``). Of Snakemake's own lines it prints those before
the jobs, then warnings and errors; the rest is in Snakemake's log file.

Snakemake imports this module before it reads a workflow, which chooses the `puckbench` to run: so
nothing of that is imported here.
"""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from snakemake.logging import DefaultFilter  # type: ignore[import-untyped]
from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

if TYPE_CHECKING:
    from rich.progress import Progress

_SECONDS_BETWEEN_LINES = 30.0
"""Where there is no terminal, a line is printed at this interval."""
_OVERDUE_S, _OVERDUE_FACTOR = 60.0, 5.0
"""A job is overdue after these seconds, and after this multiple of its expected time."""


@dataclass
class _Job:
    """A running job; told: how often it was reported as overdue."""

    rule: str
    name: str
    began: float
    told: int = 0


BARS: list[LogHandler] = []
"""The handlers that Snakemake has made; a workflow tells them what to expect."""


class LogHandler(LogHandlerBase):
    """Follows a run by the events that Snakemake logs."""

    has_filter: bool = True  # Snakemake's would keep the events of jobs from it
    has_formatter: bool = False
    needs_rulegraph: bool = False
    writes_to_file: bool = False
    writes_to_stream: bool = True

    def __post_init__(self) -> None:
        shown: Any = self.common_settings
        self.writes_to_stream = not (shown.dryrun or shown.verbose or shown.printshellcmds)
        self._is_shown = DefaultFilter(
            shown.quiet, shown.debug_dag, shown.verbose, shown.dryrun, shown.printshellcmds
        ).filter
        self.expect(lambda _: 1.0, lambda _: 0.0, 1, {})
        self._running: dict[int, _Job] = {}
        self._jobs = self._done = 0
        self._work = self._done_work = self._expected_s = 0.0
        self._began = self._told = time.monotonic()
        self._bar: Progress | None = None
        self._watch: threading.Timer | None = None
        BARS.append(self)

    def expect(
        self,
        job_s: Callable[[str], float],
        run_s: Callable[[Mapping[str, int]], float],
        cores: int,
        notes: Mapping[str, str],
    ) -> None:
        """Take the estimates of a workflow.

        Parameters
        ----------
        job_s
            Work of a job, by the name of its rule.
        run_s
            Seconds of a run of jobs (rule -> how many).
        cores
            Of the run.
        notes
            Lines to print when a rule's job has ended.
        """
        self._job_s, self._run_s, self._cores, self._notes = job_s, run_s, cores, notes

    def emit(self, record: logging.LogRecord) -> None:
        """Take in an event, and show what has changed."""
        if not self.writes_to_stream:  # Snakemake writes
            return
        event: Any = getattr(record, "event", None)
        take = {
            LogEvent.RUN_INFO: self._take_run,
            LogEvent.JOB_INFO: self._take_start,
            LogEvent.JOB_FINISHED: self._take_end,
            LogEvent.JOB_ERROR: self._take_error,
        }.get(event)
        if take:
            take(vars(record))
        elif self._jobs and _tells_of_failed_job(record):
            return
        elif (record.levelno >= logging.WARNING or not self._jobs) and self._is_shown(record):
            self._print(self.format(record))

    def close(self) -> None:
        """End the bar, if there is one."""
        self.acquire()
        if self._bar:
            self._bar.stop()
        self._bar = None
        if self._watch:
            self._watch.cancel()
        self.release()
        super().close()

    def _take_run(self, event: dict[str, Any]) -> None:
        """The jobs of the run are known: tell how long they will take."""
        jobs = {
            rule: count for rule, count in event["stats"].items() if rule not in {"all", "total"}
        }
        self._jobs = sum(jobs.values())
        self._work = sum(count * self._job_s(rule) for rule, count in jobs.items())
        self._expected_s = self._run_s(jobs)
        self._began = self._told = time.monotonic()
        left = _duration(self._expected_s)
        cores = f"{self._cores} core{'s' if self._cores > 1 else ''}"
        self._tell(f"{self._jobs} jobs, about {left} here on {cores}")
        if sys.stderr.isatty():
            self._bar = _new_bar()
            self._bar.add_task("", total=self._work, left=left)
            self._bar.start()
        self._watch_jobs()

    def _watch_jobs(self) -> None:
        """Tell of overdue jobs, now and from time to time."""
        for job in list(self._running.values()):
            running_s = time.monotonic() - job.began
            expected_s = max(1.0, self._job_s(job.rule))
            if running_s > max(_OVERDUE_S, _OVERDUE_FACTOR * expected_s) * 2**job.told:
                job.told += 1
                expected = f"{_duration(expected_s)} were expected"
                self._tell(f"still running: {job.name}, {_duration(running_s)}; {expected}")
        self._watch = threading.Timer(_SECONDS_BETWEEN_LINES, self._watch_jobs)
        self._watch.daemon = True
        self._watch.start()

    def _take_start(self, event: dict[str, Any]) -> None:
        wildcards = dict(event["wildcards"] or {})
        place = "/".join(str(value) for value in wildcards.values())
        name = f"{event['rule_name']} {place}".rstrip()
        self._running[event["jobid"]] = _Job(event["rule_name"], name, time.monotonic())
        self._show(name)

    def _take_end(self, event: dict[str, Any]) -> None:
        job = self._running.pop(event["job_id"], None)
        rule = job.rule if job else "all"
        if rule == "all":
            return
        self._done += 1
        self._done_work += self._job_s(rule)
        if rule in self._notes:
            self._tell(self._notes[rule])
        self._show()

    def _take_error(self, event: dict[str, Any]) -> None:
        """Print why a job failed, by its log."""
        from pathlib import Path

        from puckbench.planning.failures import failure_of

        self._running.pop(event.get("jobid", -1), None)
        for log in map(Path, event.get("log") or ()):
            logs = next((folder for folder in log.parents if folder.name == "logs"), None)
            if logs and log.exists() and (failure := failure_of(log, logs)):
                self._tell(f"failed: {failure}")

    def left_s(self) -> float:
        """Return the seconds left: first by the estimate, more and more by the finished jobs."""
        if not self._work or not self._done_work:
            return self._expected_s
        share = min(1.0, self._done_work / self._work)
        measured = (time.monotonic() - self._began) / share
        return (1 - share) * ((1 - share) * self._expected_s + share * measured)

    def _show(self, job: str | None = None) -> None:
        left = _duration(self.left_s())
        if self._bar:
            (task,) = self._bar.tasks
            shown = task.description if job is None else job
            self._bar.update(task.id, completed=self._done_work, left=left, description=shown)
        elif job is None and time.monotonic() - self._told >= _SECONDS_BETWEEN_LINES:
            self._told = time.monotonic()
            self._tell(f"{self._done} of {self._jobs} jobs done, {left} left")

    def _tell(self, line: str) -> None:
        self._print(f"puckbench: {line}")

    def _print(self, text: str) -> None:
        if self._bar:
            self._bar.console.print(text, highlight=False, markup=False)
        elif text not in {"", "None"}:  # an event without a text
            # One write, so that lines of other threads stay whole.
            print(f"{text}\n", end="", file=sys.stderr, flush=True)  # noqa: T201


def _tells_of_failed_job(record: logging.LogRecord) -> bool:
    """Whether a record says no more than that a job failed, which `LogEvent.JOB_ERROR` told."""
    message = record.getMessage()
    return (
        "CalledProcessError in file" in message
        or message.startswith("Exiting because a job execution failed")
        or message.endswith("At least one job did not complete successfully.")
    )


def _duration(seconds: float) -> str:
    from puckbench.report.run_record import duration_text

    return duration_text(seconds)


def _new_bar() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    return Progress(
        BarColumn(),
        TextColumn("{task.fields[left]} left"),
        TextColumn("{task.description}", style="dim"),
        console=Console(stderr=True),
        transient=True,
    )
