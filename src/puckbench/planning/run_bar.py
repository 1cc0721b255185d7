"""What a run shows while it runs: how long it will take, then one bar with what is left.

Snakemake tells every job by lines of its own; these are kept for its log file, and what is printed
of them is warnings and errors.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from puckbench.planning.run_time import machine_sample, run_seconds
from puckbench.report.run_record import duration_text

if TYPE_CHECKING:
    from rich.progress import Progress

_LOGGER = logging.getLogger("snakemake.logging")
_SECONDS_BETWEEN_LINES = 30.0
"""Where there is no terminal, a line is printed at this interval."""
_MEASURED_SHARE = 0.1
"""Of the work, after which the time left is judged by what was done so far."""


class RunBar(logging.Handler):
    """Follows a run by the events that Snakemake logs.

    Parameters
    ----------
    seconds
        What a job takes by its rule's name, as `puckbench.planning.run_time.job_seconds` has it.
    cores
        Of the run.
    notes
        Lines to print when a rule's job has ended.
    compiling_s
        What all jobs take to compile loops, as `puckbench.planning.run_time` has it.
    """

    def __init__(
        self,
        seconds: Callable[[str], float],
        cores: int,
        notes: Mapping[str, str],
        compiling_s: float = 0.0,
    ) -> None:
        super().__init__(logging.INFO)
        self._compiling_s = compiling_s
        self._seconds, self._cores, self._notes = seconds, cores, notes
        self._running: dict[int, str] = {}
        self._jobs = self._done = 0
        self._work = self._done_work = self._expected_s = 0.0
        self._began = self._told = time.monotonic()
        self._bar: Progress | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Take in an event, and show what has changed."""
        event = getattr(record, "event", None)
        take = {
            "run_info": self._take_run,
            "job_info": self._take_start,
            "job_finished": self._take_end,
        }.get(str(getattr(event, "value", "")))
        if take:
            take(vars(record))

    def close(self) -> None:
        """End the bar, if there is one."""
        if self._bar:
            self._bar.stop()
        self._bar = None
        super().close()

    def _take_run(self, event: dict[str, Any]) -> None:
        """The jobs of the run are known: tell how long they will take."""
        _warnings_alone()
        jobs = {
            rule: count for rule, count in event["stats"].items() if rule not in {"all", "total"}
        }
        self._jobs = sum(jobs.values())
        self._work = sum(count * self._seconds(rule) for rule, count in jobs.items())
        given = (self._cores, machine_sample(), self._compiling_s)
        self._expected_s = run_seconds(jobs, self._seconds, *given)
        self._began = self._told = time.monotonic()
        cores = f"{self._cores} core{'s' if self._cores > 1 else ''}"
        self._tell(f"{self._jobs} jobs, about {duration_text(self._expected_s)} here on {cores}")
        if sys.stderr.isatty():
            self._bar = _new_bar()
            self._bar.add_task("", total=self._work, left=duration_text(self._expected_s))
            self._bar.start()

    def _take_start(self, event: dict[str, Any]) -> None:
        wildcards = dict(event["wildcards"] or {})
        place = "/".join(str(value) for value in wildcards.values())
        self._running[event["jobid"]] = event["rule_name"]
        self._show(f"{event['rule_name']} {place}".rstrip())

    def _take_end(self, event: dict[str, Any]) -> None:
        rule = self._running.pop(event["job_id"], None)
        if rule is None or rule == "all":
            return
        self._done += 1
        self._done_work += self._seconds(rule)
        if rule in self._notes:
            self._tell(self._notes[rule])
        self._show()

    def left_s(self) -> float:
        """Seconds left: by the estimate at first, then by how long the jobs so far have taken."""
        if not self._work:
            return 0.0
        share = self._done_work / self._work
        if share < _MEASURED_SHARE:
            return self._expected_s * (1 - share)
        return (time.monotonic() - self._began) * (1 - share) / share

    def _show(self, job: str | None = None) -> None:
        left = duration_text(self.left_s())
        if self._bar:
            (task,) = self._bar.tasks
            shown = task.description if job is None else job
            self._bar.update(task.id, completed=self._done_work, left=left, description=shown)
        elif job is None and time.monotonic() - self._told >= _SECONDS_BETWEEN_LINES:
            self._told = time.monotonic()
            self._tell(f"{self._done} of {self._jobs} jobs done, {left} left")

    def _tell(self, line: str) -> None:
        if self._bar:
            self._bar.console.print(f"puckbench: {line}", highlight=False)
        else:
            print(f"puckbench: {line}", file=sys.stderr, flush=True)  # noqa: T201


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


def show_bar(
    seconds: Callable[[str], float],
    cores: int,
    notes: Mapping[str, str],
    compiling_s: float = 0.0,
) -> RunBar:
    """Show a bar in place of Snakemake's own lines for each job, but for warnings and errors."""
    bar = RunBar(seconds, cores, notes, compiling_s)
    _LOGGER.handlers.insert(0, bar)  # so that it can keep the others from printing
    return bar


def _warnings_alone() -> None:
    """Let Snakemake print warnings and errors from now on; its log file has everything."""
    for handler in _LOGGER.handlers:
        if isinstance(handler, logging.StreamHandler) and handler.stream is sys.stderr:
            handler.addFilter(lambda record: record.levelno >= logging.WARNING)
