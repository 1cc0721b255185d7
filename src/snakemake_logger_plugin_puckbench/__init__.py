"""Logger plug-in of Snakemake that shows a progress bar with the remaining time of a run.

``puckbench run`` uses it (``snakemake --logger puckbench``). Besides the bar, it prints an estimate
of the time before the first job, the messages that Snakemake logs until then, and all warnings and
errors. Other messages are only in Snakemake's log.

Snakemake imports this module before the workflow, which may run another copy of `puckbench`.
Therefore imports from `puckbench` are inside functions.
"""

from __future__ import annotations

import logging
import re
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
"""If there is no terminal, the progress is printed as a line at this interval, in s."""
_OVERDUE_S, _OVERDUE_FACTOR = 60.0, 5.0
"""A job is overdue after this time, in s, and after this multiple of its expected time."""
_WITHOUT_OUTPUT = re.compile(r"\bJob (\d+) +completed successfully, but some output files")


@dataclass
class _Job:
    rule: str
    name: str
    began: float
    reports: int = 0


BARS: list[LogHandler] = []
"""The handlers that Snakemake has created, to which the workflow passes the expected durations."""


class LogHandler(LogHandlerBase):
    """Log handler that counts jobs by Snakemake's log events and prints the progress of the run."""

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
        self.expect(lambda _: 1.0, 1, {})
        self._running: dict[int, _Job] = {}
        self._failures: set[tuple[str, str]] = set()
        self._jobs = self._done = 0
        self._work = self._done_work = self._expected_s = 0.0
        self._began = self._last_shown = time.monotonic()
        self._bar: Progress | None = None
        self._ended = threading.Event()
        self._watch: threading.Thread | None = None
        BARS.append(self)

    def expect(
        self,
        job_s: Callable[[str], float],
        cores: int,
        notes: Mapping[str, str],
    ) -> None:
        """Store the expected durations of a workflow's jobs, from which the progress is computed.

        Parameters
        ----------
        job_s
            Function that takes the name of a rule, and returns the expected duration of one of its
            jobs, in s.
        cores
            Number of processor cores that the run uses.
        notes
            Lines to print after each job of a rule, by the name of the rule.
        """
        self._job_s, self._cores, self._notes = job_s, cores, notes

    def emit(self, record: logging.LogRecord) -> None:
        """Process a log event of Snakemake, and update the progress."""
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
        elif job := _WITHOUT_OUTPUT.search(record.getMessage()):
            self._running.pop(int(job[1]), None)  # the only event of its end
            self._print(self.format(record))
        elif (record.levelno >= logging.WARNING or not self._jobs) and self._is_shown(record):
            self._print(self.format(record))

    def close(self) -> None:
        """Remove the progress bar, and end the thread that looks for overdue jobs."""
        self._ended.set()
        if self._watch:
            self._watch.join(timeout=1.0)  # it may wait for a terminal
        self._watch = None
        self.acquire()
        if self._bar:
            self._bar.stop()
        self._bar = None
        self.release()
        super().close()

    def _take_run(self, event: dict[str, Any]) -> None:
        jobs = {
            rule: count for rule, count in event["stats"].items() if rule not in {"all", "total"}
        }
        self._jobs = sum(jobs.values())
        self._work = sum(count * self._job_s(rule) for rule, count in jobs.items())
        self._expected_s = self._work / self._cores
        self._began = self._last_shown = time.monotonic()
        left = _duration(self._expected_s)
        cores = f"{self._cores} core{'s' if self._cores > 1 else ''}"
        self._tell(f"{self._jobs} jobs, about {left} here on {cores}")
        if sys.stderr.isatty():
            self._bar = _new_bar()
            self._bar.add_task("", total=self._work, left=left)
            self._bar.start()
        if not self._watch:
            self._watch = threading.Thread(target=self._watch_jobs, daemon=True)
            self._watch.start()

    def _watch_jobs(self) -> None:
        while not self._ended.wait(_SECONDS_BETWEEN_LINES):
            self._tell_overdue_jobs()

    def _tell_overdue_jobs(self) -> None:
        for job in list(self._running.values()):
            running_s = time.monotonic() - job.began
            expected_s = max(1.0, self._job_s(job.rule))
            if running_s > max(_OVERDUE_S, _OVERDUE_FACTOR * expected_s) * 2**job.reports:
                job.reports += 1
                expected = f"{_duration(expected_s)} were expected"
                self._tell(f"still running: {job.name}, {_duration(running_s)}; {expected}")

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
        from pathlib import Path

        from puckbench.planning.failures import failure_key, failure_of

        self._running.pop(event.get("jobid", -1), None)
        for log in map(Path, event.get("log") or ()):
            logs = next((folder for folder in log.parents if folder.name == "logs"), None)
            if logs and log.exists() and (failure := failure_of(log, logs)):
                key = failure_key(failure)
                if key not in self._failures:
                    self._tell(f"failed: {failure}")
                self._failures.add(key)

    def left_s(self) -> float:
        """Estimate the remaining time of the run, in s.

        At first, the estimate follows from the expected durations of the jobs. The more jobs are
        finished, the more it follows from the time that these took.
        """
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
        elif job is None and time.monotonic() - self._last_shown >= _SECONDS_BETWEEN_LINES:
            self._last_shown = time.monotonic()
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
