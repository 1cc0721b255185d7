"""What a run shows while it runs, from the events that Snakemake logs."""

from __future__ import annotations

import logging
from typing import Any

import pytest
from snakemake_interface_logger_plugins.common import LogEvent

from puckbench.planning import run_bar
from puckbench.planning.run_bar import RunBar
from puckbench.planning.run_time import SAMPLE_S

JOBS = {"long": 2, "short": 2, "all": 1, "total": 5}


class Clock:
    """A clock that is set by hand."""

    now = 0.0

    def monotonic(self) -> float:
        """The time that it was set to."""
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(run_bar, "time", found)
    monkeypatch.setattr(run_bar, "machine_sample", lambda: SAMPLE_S)
    return found


def told(bar: RunBar, event: LogEvent, **values: Any) -> None:
    record = logging.LogRecord("snakemake", logging.INFO, "", 0, "", (), None)
    vars(record).update(event=event, **values)
    bar.emit(record)


def begun() -> RunBar:
    """A run of two jobs of 90 s and two of 10 s, on two cores."""
    bar = RunBar({"long": 90.0, "short": 10.0}.__getitem__, 2, {"short": "a short one ended"})
    told(bar, LogEvent.RUN_INFO, stats=JOBS)
    return bar


def job(bar: RunBar, number: int, rule: str) -> None:
    told(bar, LogEvent.JOB_INFO, jobid=number, rule_name=rule, wildcards={"cloud": "a"})
    told(bar, LogEvent.JOB_FINISHED, job_id=number)


def test_a_run_says_at_its_start_how_long_it_will_take(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    assert begun().left_s() == 100
    assert capsys.readouterr().err == "puckbench: 4 jobs, about 2 min here on 2 cores\n"


def test_the_time_left_follows_the_jobs_that_are_done(clock: Clock) -> None:
    bar = begun()
    job(bar, 1, "short")
    assert bar.left_s() == pytest.approx(95)  # too few to judge by: what was expected
    clock.now = 120.0
    job(bar, 2, "long")  # half of the work, in 120 s
    assert bar.left_s() == pytest.approx(120)
    clock.now = 200.0
    job(bar, 3, "long")
    job(bar, 4, "short")
    job(bar, 5, "all")
    assert bar.left_s() == 0


def test_a_note_is_printed_when_its_job_has_ended(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    bar = begun()
    job(bar, 1, "long")
    assert "short" not in capsys.readouterr().err
    job(bar, 2, "short")
    assert capsys.readouterr().err == "puckbench: a short one ended\n"


def test_where_there_is_no_terminal_a_line_is_printed_now_and_then(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    bar = begun()
    capsys.readouterr()
    for number in range(2):
        clock.now += 20
        job(bar, number, "long")
    assert capsys.readouterr().err == "puckbench: 2 of 4 jobs done, 4 s left\n"
