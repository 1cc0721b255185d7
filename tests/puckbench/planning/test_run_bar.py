"""What a run shows while it runs, from the events that Snakemake logs."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from snakemake.exceptions import MissingOutputException, format_exception_to_string
from snakemake.settings.enums import Quietness
from snakemake_interface_logger_plugins.common import LogEvent
from snakemake_interface_logger_plugins.settings import LogHandlerSettingsBase
from snakemake_interface_logger_plugins.tests import MockOutputSettings, TestLogHandlerBase

from snakemake_logger_plugin_puckbench import BARS, LogHandler

JOBS = {"long": 2, "short": 2, "all": 1, "total": 5}


class Clock:
    """A clock that is set by hand."""

    now = 0.0

    def monotonic(self) -> float:
        """The time that it was set to."""
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    result = Clock()
    monkeypatch.setattr("snakemake_logger_plugin_puckbench.time", result)
    return result


@pytest.fixture(autouse=True)
def closed_bars() -> Iterator[None]:
    """Close the handlers of a test, so that none of them prints during a later test."""
    yield
    for bar in BARS:
        bar.close()


class TestInterface(TestLogHandlerBase):
    """Snakemake's own tests of a logger plug-in."""

    __test__ = True

    def get_log_handler_cls(self) -> type[LogHandler]:
        return LogHandler

    def get_log_handler_settings(self) -> LogHandlerSettingsBase:
        return LogHandlerSettingsBase()


def settings(**changes: object) -> MockOutputSettings:
    shown = MockOutputSettings()
    vars(shown).update({"printshellcmds": False, "quiet": set(), **changes})
    return shown


def told(bar: LogHandler, event: LogEvent | None, **values: Any) -> None:
    record = logging.LogRecord("snakemake", logging.INFO, "", 0, "", (), None)
    vars(record).update(event=event, **values)
    bar.emit(record)


def begun() -> LogHandler:
    """A run of two jobs of 90 s and two of 10 s, on two cores."""
    bar = LogHandler(settings(), None)
    work = {"long": 90.0, "short": 10.0}
    bar.expect(
        work.__getitem__,
        2,
        {"short": "a short one ended"},
    )
    told(bar, LogEvent.RUN_INFO, stats=JOBS)
    return bar


def job(bar: LogHandler, number: int, rule: str) -> None:
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
    assert bar.left_s() == pytest.approx(0.95 * 0.95 * 100)  # mostly what was expected
    clock.now = 120.0
    job(bar, 2, "long")  # half of the work, in 120 s
    assert bar.left_s() == pytest.approx(0.5 * (0.5 * 100 + 0.5 * 240))
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
    assert capsys.readouterr().err == "puckbench: 2 of 4 jobs done, 5 s left\n"


def test_warnings_are_printed_and_what_snakemake_is_told_to_keep_quiet_is_not(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    bar = LogHandler(settings(quiet={Quietness.RULES}), None)
    told(bar, None, msg="before the jobs")
    told(bar, LogEvent.RUN_INFO, stats=JOBS)
    told(bar, None, msg="while they run")
    told(bar, None, msg="a fault", levelno=logging.ERROR)
    told(bar, LogEvent.JOB_ERROR, msg="of a rule", levelno=logging.ERROR)
    first, *rest = capsys.readouterr().err.splitlines()
    assert (first, rest[-1], len(rest)) == ("before the jobs", "a fault", 2)


@pytest.mark.parametrize("asked", ["dryrun", "verbose", "printshellcmds"])
def test_where_more_than_a_bar_is_asked_for_snakemake_writes(
    asked: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bar = LogHandler(settings(**{asked: True}), None)
    assert not bar.writes_to_stream
    told(bar, LogEvent.RUN_INFO, stats=JOBS)
    assert capsys.readouterr().err == ""


def test_an_overdue_job_is_named(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    bar = begun()
    told(bar, LogEvent.JOB_INFO, jobid=1, rule_name="short", wildcards={"cloud": "a"})
    clock.now = 59.0
    bar._tell_overdue_jobs()
    clock.now = 61.0
    bar._tell_overdue_jobs()
    clock.now = 100.0
    bar._tell_overdue_jobs()
    bar.close()
    lines = capsys.readouterr().err.splitlines()[1:]
    assert lines == ["puckbench: still running: short a, 61 s; 10 s were expected"]


def test_overdue_jobs_are_looked_for_until_the_run_ends(
    clock: Clock, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("snakemake_logger_plugin_puckbench._SECONDS_BETWEEN_LINES", 0.01)
    bar = begun()
    told(bar, LogEvent.JOB_INFO, jobid=1, rule_name="short", wildcards={"cloud": "a"})
    clock.now = 61.0
    deadline = time.monotonic() + 30
    output = ""
    while "still running" not in output and time.monotonic() < deadline:
        time.sleep(0.01)
        output += capsys.readouterr().err
    assert output.splitlines()[1:] == [
        "puckbench: still running: short a, 61 s; 10 s were expected"
    ]
    bar.close()
    clock.now = 10_000.0
    time.sleep(0.1)
    assert capsys.readouterr().err == ""


def test_a_job_that_ended_without_its_files_is_not_running(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    bar = begun()
    told(bar, LogEvent.JOB_INFO, jobid=1, rule_name="short", wildcards={"cloud": "a"})
    missing = MissingOutputException("Missing files after 5 seconds:", jobid=1)
    text = format_exception_to_string(missing)
    bar.emit(logging.LogRecord("snakemake", logging.ERROR, "", 0, text, (), None))
    clock.now = 200.0
    bar._tell_overdue_jobs()
    bar.close()
    output = capsys.readouterr().err
    assert "some output files are missing" in output
    assert "still running" not in output


def test_a_failed_job_is_one_line(
    clock: Clock, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    bar = begun()
    log = tmp_path / "logs" / "coded" / "d" / "a" / "c.log"
    log.parent.mkdir(parents=True)
    log.write_text("puckbench: IndexError: no (c.py:1)\n")
    told(bar, LogEvent.JOB_INFO, jobid=1, rule_name="short", wildcards={"cloud": "a"})
    record = logging.LogRecord(
        "snakemake", logging.ERROR, "", 0, "CalledProcessError in file x", (), None
    )
    bar.emit(record)
    told(bar, LogEvent.JOB_ERROR, jobid=1, rule_name="short", log=[str(log)])
    (line,) = capsys.readouterr().err.splitlines()[1:]
    assert line == f"puckbench: failed: codec c, cloud d/a: IndexError: no (c.py:1); log: {log}"
